"""Robots with a common interface (``robot``): LeRobot's SO-101 (``lerobot_arm``) and a mock robot (``mock``)."""
