"""The preflight check: one request to a policy before a run, with everything that it gets and answers."""
