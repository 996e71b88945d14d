"""One trial in one process: the policy, the thread it answers in, and the record."""
