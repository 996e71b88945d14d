"""Clients of policy servers and of checkpoints: openpi, GR00T, Being-H, starVLA, OpenVLA, X-VLA, vla-eval and LeRobot.

``connect`` returns the client for an address. Each protocol has one file, which uses ``remote``, ``connection`` and,
for ZeroMQ, ``endpoint_server``. ``checkpoint`` and ``lerobot_types`` load checkpoints of LeRobot. ``bridges`` contains
scripts that run next to a third-party server.
"""
