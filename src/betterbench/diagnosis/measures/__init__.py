"""Measures over many trials: metrics of a run, and the confusion and power matrices of the diagnosis."""
