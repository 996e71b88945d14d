"""Preflight check of a policy: conventions, inputs, actions and latency."""
