"""Workers that run several trials alternately in one thread, and a pool of worker processes on this machine."""
