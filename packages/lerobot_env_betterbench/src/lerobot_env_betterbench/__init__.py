"""Plugin that LeRobot 0.6 or later imports automatically, which makes ``--env.type=betterbench`` work."""

from betterbench.episodes.envhub.config import BetterbenchEnv

__all__ = ["BetterbenchEnv"]
