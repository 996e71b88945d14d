"""Plugin for ``--env.type=betterbench``. LeRobot 0.6 or later imports it automatically."""

from betterbench.episodes.envhub.config import BetterbenchEnv

__all__ = ["BetterbenchEnv"]
