"""Preflight check: requests to a policy before a run, with the policy's inputs and answers."""
