"""Simulation code. It needs MuJoCo, an OpenGL back end, or a simulator that is installed in a separate environment.

- ``graphics``: OpenGL back ends and devices, and checks of both.
- ``robots``: models of the robots, their inverse kinematics and their controller.
- ``assets``: objects with visual and collision geometry. ``procedural`` has one file per category.
- ``scenes``: one compiled model of the assets, the robot and the furniture, and code that steps, renders and checks it.
- ``worlds``: betterbench's own world, and the worlds of LIBERO, LIBERO-Plus and CALVIN. Each of these three simulators
  runs in a separate process and Python environment.
- ``modalities``: images, depth, masks, boxes and flow of every recorded state (`better materialize`).
"""
