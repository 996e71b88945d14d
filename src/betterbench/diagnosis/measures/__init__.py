"""Measures over many trials: a run's metrics, and the confusion and power matrices of the diagnosis."""
