"""Demonstrations: given by the expert in a human manner, amplified to new starts, and kept in ordinary run folders.

From the bottom up: :mod:`~betterbench.demonstrations.starts` (which seeds), :mod:`~betterbench.demonstrations.manner`
(how the expert varies), :mod:`~betterbench.demonstrations.sources`, :mod:`~betterbench.demonstrations.transit` and
:mod:`~betterbench.demonstrations.retarget` (skills and the ways to them, and how they are carried over),
:mod:`~betterbench.demonstrations.amplifier` and :mod:`~betterbench.demonstrations.attempt` (one attempt),
:mod:`~betterbench.demonstrations.production` (a whole set), :mod:`~betterbench.demonstrations.variety` (how far its
demonstrations are apart) and :mod:`~betterbench.demonstrations.acceptance` (what became of the attempts).
"""
