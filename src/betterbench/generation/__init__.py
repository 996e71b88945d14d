"""Generation: tasks made from descriptions instead of written by hand.

- ``better_release``: import and audit of tasks in the format of the BeTTER release.
"""
