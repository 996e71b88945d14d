"""Training sets: demonstrations of exactly one regime, with checks, card, statistics and audit."""
