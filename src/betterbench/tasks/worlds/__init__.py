"""Data about worlds: facts, suites and protocols of LIBERO and LIBERO-Plus, and CALVIN's chains.

The simulators are in :mod:`betterbench.sim.worlds`.
"""
