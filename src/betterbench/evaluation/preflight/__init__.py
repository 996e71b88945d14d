"""Preflight check of a policy before a run: its conventions, inputs, actions and latency."""
