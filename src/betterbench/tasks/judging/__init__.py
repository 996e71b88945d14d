"""Judging of a trial from its states: goals, grasp attempts, restraint, harm and premises."""
