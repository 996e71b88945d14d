"""Simulation code. It needs MuJoCo, an OpenGL back end, or a simulator that is installed in a separate environment.

- ``graphics``: OpenGL back ends and devices, and checks of both.
- ``robots``: models of the robots, their inverse kinematics and their controller.
- ``assets``: objects with visual and collision geometry. ``procedural`` has one file per category.
- ``scenes``: assets, robot and furniture as one compiled model that is stepped, rendered and checked.
- ``worlds``: betterbench's own world, and those of LIBERO, LIBERO-Plus and CALVIN, whose simulators run in processes
  and environments of their own.
- ``modalities``: images, depth, masks, boxes and flow of every recorded state (`better materialize`).
"""
