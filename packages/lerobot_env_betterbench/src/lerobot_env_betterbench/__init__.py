"""What LeRobot imports by itself, from version 0.6 on, so that its commands know ``--env.type=betterbench``."""

from betterbench.episodes.envhub.config import BetterbenchEnv

__all__ = ["BetterbenchEnv"]
