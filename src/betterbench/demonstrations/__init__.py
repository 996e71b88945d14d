"""Collect demonstrations, build training sets from them, audit them for shortcuts, and export them for other trainers.

- ``making``: expert demonstrations (`better collect`), and more demonstrations generated from a few (`better amplify`).
- ``teleop``: human demonstrations in the browser (`better teleop`).
- ``shortcuts``: associations in demonstrations that a learner could exploit (`better shortcuts`).
- ``export``: data sets in the formats of LeRobot and robomimic (`better export`).
- ``sets``: a training set with its card, checks and audit (`better dataset`).
- ``recipes``: training configurations for openpi, GR00T, Being-H and LeRobot (`better recipe`).
"""
