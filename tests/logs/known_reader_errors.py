"""Where rosbags' AnyReader is wrong, or cannot read what can be read: the one list of exceptions.

Each entry is shown right by another oracle in ``test_every_field.py``.
"""

# log -> why AnyReader cannot be compared with
UNREADABLE = {
    "steering_mcap": "refuses an MCAP whose profile is not ros2",
    "steering_dds": "does not read definitions in IDL of DDS",
    "eprosima/ros2_talker.mcap": "refuses types named 'fastdds/...' and a type name without a package",
    "rosbag2/rosbag2_tests_mcap_bag_with_topics_and_service_events": "refuses all for one definition",
    "rosbag2/rosbag2_py_mcap_talker": "leaves out messages outside the range of metadata.yaml",
    "rosbag2/rosbag2_py_sqlite3_talker": "leaves out messages outside the range of metadata.yaml",
}

# log -> fields of type byte: an octet, which rosbags reads as int8 (255 is -1 there; the definition in the
# log gives 255 as a default, which an int8 cannot be). An octet of IDL suffers the same.
SIGNED_OCTETS = {"rosbag2/rosbag2_tests_sqlite3_cdr_test": r".*byte_value(s|_default|s_default)?(\[\d+\])?"}
