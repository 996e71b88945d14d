"""Complete runs: running a plan, external loops, and replaying a record."""
