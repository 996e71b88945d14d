"""Integration with LeRobot's environment hub.

- ``env.py`` is a complete package for the hub. After it has been uploaded to a repository such as ``you/better``,
  LeRobot's ``make_env("you/better")`` creates the environments of betterbench.
- ``config.py`` registers ``--env.type=betterbench`` for LeRobot's commands, which must be called with
  ``--env.discover_packages_path=betterbench.episodes.envhub``.
"""
