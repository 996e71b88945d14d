"""Demonstrations: production, training sets, shortcut audits, and export for other trainers.

- ``making``: demonstrations of the expert, and their amplification to new starts (`better collect`, `better amplify`).
- ``teleop``: demonstrations of a person in the browser (`better teleop`).
- ``shortcuts``: associations in demonstrations that a learner could use as shortcuts (`better shortcuts`).
- ``export``: data sets of LeRobot and robomimic (`better export`).
- ``sets``: a training set with its card, checks and audit (`better dataset`).
- ``recipes``: the files with which openpi, GR00T, Being-H and LeRobot train on an export (`better recipe`).
"""
