"""Balanced training conditions: the same skills with words, slots, orders and objects crossed.

One file per task of the suite, see :mod:`betterbench.tasks.regimes`. Objects are not picked from the slots in
``ASIDE``.
"""
