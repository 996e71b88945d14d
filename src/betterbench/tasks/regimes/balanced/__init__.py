"""Balanced training conditions: they train the same skills, but words, slots, orders and objects are crossed.

This means that all combinations occur, so that none of these properties predicts another. Each task of the suite has
one file (see :mod:`betterbench.tasks.regimes`). Objects are not picked from the slots in ``ASIDE``.
"""
