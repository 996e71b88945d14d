"""Plans of runs, manifests written at the start of runs, and plans that repeat another run."""
