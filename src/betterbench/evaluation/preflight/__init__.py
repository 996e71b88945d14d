"""The preflight check: a policy is asked once before a run, and everything that it gets and answers is shown."""
