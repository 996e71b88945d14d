"""Carrying a plan out: from the first trial to the last, interrupted and resumed."""
