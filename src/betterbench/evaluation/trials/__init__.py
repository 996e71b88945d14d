"""Execution of one trial in one process: policy, policy thread, episode and record."""
