"""LIVE DDS -> LOG FILE: what is published in a DDS domain, recorded as MCAP.

``recorder.record`` joins a domain, asks each writer for the definition of its type, and writes the payloads
as they came. It needs Cyclone DDS (the extra ``dds``); nothing else of ident does.
"""
