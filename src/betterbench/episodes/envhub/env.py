"""Complete package for LeRobot's environment hub, which consists of this file and a requirement on betterbench."""

from betterbench.episodes.lerobot_env import make_env

__all__ = ["make_env"]
