"""Measures that are computed over many trials: the metrics of a run, and the confusion and power matrices.

The confusion matrix measures the accuracy of the diagnosis. The power matrix measures the success rates of policies
that lack the tested ability.
"""
