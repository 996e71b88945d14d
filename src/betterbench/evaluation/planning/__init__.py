"""Planning of runs: the plan, the manifest, and repeating an earlier run."""
