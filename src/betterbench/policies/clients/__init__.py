"""Clients of policy servers and checkpoints: openpi, GR00T, Being-H, starVLA, OpenVLA and X-VLA, vla-eval, LeRobot.

``connect`` returns the client of an address; each protocol has one file, over ``remote``, ``connection`` and, for
ZeroMQ, ``endpoint_server``. ``checkpoint`` and ``lerobot_types`` load checkpoints of LeRobot. ``bridges`` has scripts
that run beside a foreign server.
"""
