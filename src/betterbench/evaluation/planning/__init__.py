"""Run plans, manifests written at the start of runs, and plans that repeat another run."""
