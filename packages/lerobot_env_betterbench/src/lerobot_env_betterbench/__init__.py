"""Plugin that LeRobot (version 0.6 or later) imports automatically, so that ``--env.type=betterbench`` works."""

from betterbench.episodes.envhub.config import BetterbenchEnv

__all__ = ["BetterbenchEnv"]
