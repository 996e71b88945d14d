"""Package for LeRobot's environment hub. It consists of this file, which requires that betterbench is installed."""

from betterbench.episodes.lerobot_env import make_env

__all__ = ["make_env"]
