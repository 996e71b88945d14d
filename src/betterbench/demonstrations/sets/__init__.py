"""Training sets: demonstrations of one training distribution, with checks, card, statistics and audit."""
