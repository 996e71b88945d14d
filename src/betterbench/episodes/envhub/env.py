"""Complete package for LeRobot's environment hub. The package consists of this file alone and requires betterbench."""

from betterbench.episodes.lerobot_env import make_env

__all__ = ["make_env"]
