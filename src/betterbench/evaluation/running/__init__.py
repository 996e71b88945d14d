"""Whole runs: a plan from its first trial to its last, a run that your own loop fills, and the replay of a record."""
