"""Robots of a protocol behind one protocol (``robot``): lerobot's SO-101 (``lerobot_arm``), and a mock (``mock``)."""
