"""Numbers over many trials: metrics of a run, the confusion matrix and the power matrix of the diagnosis."""
