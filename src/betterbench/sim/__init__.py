"""Simulation code. It needs MuJoCo, an OpenGL back end, or a simulator in a separate environment.

- ``graphics``: OpenGL back ends and devices, and checks of them.
- ``robots``: the arm as MJCF, its inverse kinematics and its controller.
- ``assets``: objects with visual and collision geometry. ``procedural`` has one file per category.
- ``scenes``: assets, robot and furniture as one compiled model that is stepped, rendered and checked.
- ``worlds``: the simulators of LIBERO, LIBERO-Plus and CALVIN, each in a separate process and environment.
- ``modalities``: images, depth, masks, boxes and flow of every recorded state (`better materialize`).
"""
