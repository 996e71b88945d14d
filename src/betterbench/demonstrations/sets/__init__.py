"""Training sets: demonstrations of exactly one regime, with a proof, card, statistics and audit."""
