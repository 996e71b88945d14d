"""Demonstrations: given by the expert in a human manner, amplified to new starts, and kept in ordinary run folders.

From the bottom up: :mod:`~betterbench.demonstrations.making.starts` (which seeds),
:mod:`~betterbench.demonstrations.making.manner` (how the expert varies),
:mod:`~betterbench.demonstrations.making.sources`, :mod:`~betterbench.demonstrations.making.transit` and
:mod:`~betterbench.demonstrations.making.retarget` (skills and the ways to them, and how they are carried over),
:mod:`~betterbench.demonstrations.making.amplifier` and :mod:`~betterbench.demonstrations.making.attempt` (one attempt),
:mod:`~betterbench.demonstrations.making.production` (a whole set), :mod:`~betterbench.demonstrations.making.variety`
(how far its demonstrations are apart) and :mod:`~betterbench.demonstrations.making.acceptance` (what became of the
attempts).
"""
