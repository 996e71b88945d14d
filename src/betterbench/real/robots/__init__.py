"""Robots with a common interface (``robot``): lerobot's SO-101 (``lerobot_arm``) and a mock (``mock``)."""
