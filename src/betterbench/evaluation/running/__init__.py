"""Complete runs: execution of a plan, external loops, and replay of records."""
