"""Integration with LeRobot's environment hub.

- ``env.py`` is a complete hub package. Upload it unchanged, and LeRobot's ``make_env("you/better")`` finds our tasks.
- ``config.py`` registers ``--env.type=betterbench`` for the commands of LeRobot with
  ``--env.discover_packages_path=betterbench.episodes.envhub``.
"""
