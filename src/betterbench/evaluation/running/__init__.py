"""Execution of complete runs: from a plan, by the user's own loop, or as a replay of records."""
