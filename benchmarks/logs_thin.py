"""Which fields of the thin channels ``bench_logs.py`` reads: topic -> fields."""

THIN = {
    "/steering/request": ["angle"],
    "/steering/measured": ["angle"],
    "/imu": [f"{name}.{axis}" for name in ("angular_velocity", "linear_acceleration") for axis in "xyz"],
    "/odometry": [
        *(f"pose.pose.position.{axis}" for axis in "xy"),
        *(f"pose.pose.orientation.{axis}" for axis in "xyzw"),
        *(f"twist.twist.linear.{axis}" for axis in "xy"),
    ],
    "/twist": ["twist.linear.x", "twist.angular.z"],
}
