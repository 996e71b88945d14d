"""Workers that run several trials concurrently in one thread, and a pool of worker processes on this machine."""
