"""Whole runs: running a plan, filling a run from your own loop, and replaying a record."""
