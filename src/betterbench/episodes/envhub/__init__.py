"""Integration with LeRobot's environment hub.

- ``env.py`` is a complete package for the hub. If it is uploaded unchanged, LeRobot's ``make_env("you/better")`` finds
  the tasks of betterbench.
- ``config.py`` registers ``--env.type=betterbench`` for LeRobot's commands, which need
  ``--env.discover_packages_path=betterbench.episodes.envhub``.
"""
