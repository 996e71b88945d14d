"""Workers: one thread that interleaves several trials, and a pool of processes on this machine that each hold one."""
