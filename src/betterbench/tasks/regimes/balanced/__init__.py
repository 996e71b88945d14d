"""Balanced training conditions: they train the same skills, but words, slots, orders and objects are crossed.

Crossed properties occur in many combinations, so that none of them predicts another. Each task of the suite has one
file (see :mod:`betterbench.tasks.regimes`). Objects are not picked from the slots in ``ASIDE``.
"""
