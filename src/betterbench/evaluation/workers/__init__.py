"""Workers, which interleave several trials in one thread, and a pool of worker processes on this machine."""
