"""Training sets: demonstrations of exactly one training distribution, with checks, card, statistics and audit."""
