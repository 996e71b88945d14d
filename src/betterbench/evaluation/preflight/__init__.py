"""Preflight check of a policy before a run: conventions, inputs, actions and latency."""
