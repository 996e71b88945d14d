"""Workers that run several trials in turn in one thread, and a pool of worker processes on this machine."""
