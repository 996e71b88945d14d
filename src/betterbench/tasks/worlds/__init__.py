"""Data about worlds: facts about all worlds, suites and protocols of LIBERO and LIBERO-Plus, and CALVIN's chains.

The simulators are in :mod:`betterbench.sim.worlds`.
"""
