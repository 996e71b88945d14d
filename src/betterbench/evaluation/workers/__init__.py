"""Workers that interleave several trials in a thread, and a pool of worker processes on this machine."""
