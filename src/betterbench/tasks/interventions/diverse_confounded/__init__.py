"""The diverse-confounded regime: the balanced one, except that each word stays tied to its place.

It shows as many conditions as the balanced regime, at least as many layouts, and the same objects beside those that are
requested. All of its conditions that keep the words tied are those of the balanced regime. In place of the others it
has conditions with other objects beside the one that is requested, or without them. So learners of the two differ by
what a word goes with, and not by how much they were shown.

Two tasks have it, one file each, see :mod:`betterbench.tasks.interventions.listed_regimes`.
"""
