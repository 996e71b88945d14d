"""Measures over many trials: the metrics of a run, and the confusion and power matrices of the diagnosis."""
