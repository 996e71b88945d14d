"""Plans of runs, manifests, and repetition of other runs."""
