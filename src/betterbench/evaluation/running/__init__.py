"""Complete runs: execution of a plan, runs controlled by the user's own loop, and replay of records."""
