"""Balanced training conditions, with the same skills but with words, slots, orders and objects crossed.

Each task of the suite has one file (see :mod:`betterbench.tasks.regimes`). Objects are not picked from the slots in
``ASIDE``.
"""
