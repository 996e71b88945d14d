"""The tasks of the suite, one short file each."""

from betterbench.tasks.suite import fast_food, morning_coffee

__all__ = ["fast_food", "morning_coffee"]
