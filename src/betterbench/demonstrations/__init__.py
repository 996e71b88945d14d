"""Demonstrations: made, collected in training sets, audited for shortcuts, and written for other trainers.

- ``making``: demonstrations of the expert, and their amplification to new starts (`better collect`, `better amplify`).
- ``teleop``: demonstrations of a person in the browser (`better teleop`).
- ``shortcuts``: what goes together in demonstrations, and what a learner of them could go by (`better shortcuts`).
- ``export``: data sets of LeRobot and robomimic (`better export`).
- ``sets``: the training set of a regime with its card, proof and audit (`better dataset`).
- ``recipes``: the files with which openpi, GR00T, Being-H and LeRobot train on an export (`better recipe`).
"""
