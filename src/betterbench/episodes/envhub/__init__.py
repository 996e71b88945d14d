"""The environment hub: what LeRobot imports to find our tasks.

- ``env.py`` is the whole of a hub package: upload it as it is, and LeRobot's ``make_env("you/better")`` finds ours.
- ``config.py`` makes ``--env.type=betterbench`` known to the commands of LeRobot when they are told
  ``--env.discover_packages_path=betterbench.episodes.envhub``.
"""
