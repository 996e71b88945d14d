"""Judging of a trial from its states, with goals, grasp attempts, restraint, harm and premises."""
