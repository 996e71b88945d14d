"""Expert demonstrations in varied motion styles, and demonstrations generated from them for new initial states.

From the bottom up: :mod:`~betterbench.demonstrations.making.starts` (choice of seeds),
:mod:`~betterbench.demonstrations.making.manner` (motion styles of the expert),
:mod:`~betterbench.demonstrations.making.sources`, :mod:`~betterbench.demonstrations.making.transit` and
:mod:`~betterbench.demonstrations.making.retarget` (skills, transits between skills, and their transfer),
:mod:`~betterbench.demonstrations.making.amplifier` and :mod:`~betterbench.demonstrations.making.attempt` (one attempt),
:mod:`~betterbench.demonstrations.making.production` (a complete set), :mod:`~betterbench.demonstrations.making.variety`
(differences between its demonstrations) and :mod:`~betterbench.demonstrations.making.acceptance` (attempt outcomes).
"""
