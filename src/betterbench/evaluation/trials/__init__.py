"""One trial in one process: the policy, the thread in which it answers, and the run of the episode up to its record."""
