"""Complete package for LeRobot's environment hub. It consists only of this file, and requires betterbench."""

from betterbench.episodes.lerobot_env import make_env

__all__ = ["make_env"]
