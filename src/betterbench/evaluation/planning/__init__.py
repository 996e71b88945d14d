"""Planning of runs: plan, manifest, and repetition of an earlier run."""
