"""The diverse-confounded regime: like the balanced one, except that each word stays tied to its slot.

It has as many conditions as the balanced regime, at least as many layouts, and the same additional objects. All
balanced conditions that keep the words tied are included. The others are replaced by conditions with other objects
beside the requested one, or without them. Learners of the two regimes therefore differ in the associations of words,
and not in the amount of data.

Two tasks have it, one file each, see :mod:`betterbench.tasks.interventions.listed_regimes`.
"""
