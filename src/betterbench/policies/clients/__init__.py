"""Clients of policy servers and checkpoints: openpi, GR00T, Being-H, starVLA, OpenVLA and X-VLA, vla-eval, LeRobot.

``connect`` returns the client of an address. Each protocol has one file, which uses ``remote``, ``connection`` and, for
ZeroMQ, ``endpoint_server``. ``checkpoint`` and ``lerobot_types`` load checkpoints of LeRobot. ``bridges`` contains
scripts to run next to a third-party server.
"""
