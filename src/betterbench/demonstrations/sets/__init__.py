"""Training sets: demonstrations of a regime, proven to show it and nothing else, with card, statistics and audit."""
