"""The preflight check of a policy: one exchange, drawn and written down before a run."""
