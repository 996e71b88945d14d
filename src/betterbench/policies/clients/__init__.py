"""Clients of policy servers and of checkpoints: openpi, GR00T, Being-H, starVLA, OpenVLA, X-VLA, vla-eval and LeRobot.

Each protocol has its own module, built on ``remote`` and ``connection`` (and on ``endpoint_server`` for ZeroMQ).
``checkpoint`` and ``lerobot_types`` load LeRobot checkpoints. ``bridges`` contains scripts that run on the machine of a
third-party policy server.
"""
