"""A package of LeRobot's environment hub: a folder with this file, beside a requirement on betterbench."""

from betterbench.episodes.lerobot_env import make_env

__all__ = ["make_env"]
