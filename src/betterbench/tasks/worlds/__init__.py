"""Data about worlds: facts, suites and protocols of LIBERO and LIBERO-Plus, and the chains of CALVIN.

The simulators are in :mod:`betterbench.sim.worlds`.
"""
