"""One trial in one process: the policy, its thread, and the episode up to its record."""
