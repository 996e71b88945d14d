"""Diverse-confounded regime: like the balanced regime, except that each word stays tied to its slot.

The regime has as many conditions as the balanced regime, at least as many layouts, and the same additional objects. It
includes all balanced conditions in which each word is tied to its slot. The other balanced conditions are replaced by
conditions that have different bystanders, or none. Policies trained on the two regimes therefore differ in the
association of words with slots, not in the amount of data.

Two tasks have this regime, with one file each (see :mod:`betterbench.tasks.regimes`).
"""
