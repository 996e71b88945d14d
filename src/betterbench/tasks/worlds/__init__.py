"""Worlds as data: facts about each, suites and protocols for LIBERO and LIBERO-Plus, and CALVIN's chains.

The simulators are in :mod:`betterbench.sim.worlds`.
"""
