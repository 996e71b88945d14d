"""Diverse-confounded regime: like the balanced regime, except that each word stays tied to its slot.

The regime has as many conditions as the balanced regime, at least as many layouts, and the same additional objects. It
includes all balanced conditions that keep words tied to slots, and replaces the other conditions with conditions that
have different bystanders or no bystanders. Learners trained on the two regimes therefore differ in word associations,
not in the amount of data.

Two tasks have this regime, with one file each (see :mod:`betterbench.tasks.regimes`).
"""
