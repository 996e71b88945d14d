"""Training sets: demonstrations of a training distribution, with checks, dataset card, statistics and audit."""
