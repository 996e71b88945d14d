"""Foreign worlds as data: suites and protocols of LIBERO, LIBERO-PRO and LIBERO-Plus, and the chains of CALVIN.

The simulators of these worlds are in :mod:`betterbench.sim.worlds`.
"""
