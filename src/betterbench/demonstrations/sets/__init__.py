"""Training sets: demonstrations of a training distribution, with checks, card, statistics and audit."""
