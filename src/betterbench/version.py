"""Version of betterbench."""

__version__ = "0.1.0"
