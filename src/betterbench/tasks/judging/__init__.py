"""Judging of a trial from its world states: goals, grasp attempts, restraint, harm and premises."""
