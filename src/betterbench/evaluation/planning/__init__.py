"""The plan of a run, the manifest written at its start, and plans that repeat another run."""
