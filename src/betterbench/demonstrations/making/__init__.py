"""Make demonstrations with a scripted expert, and generate more from them for new initial states.

From the bottom up: :mod:`~betterbench.demonstrations.making.starts` (choice of seeds),
:mod:`~betterbench.demonstrations.making.manner` (motion styles of the expert),
:mod:`~betterbench.demonstrations.making.sources`, :mod:`~betterbench.demonstrations.making.transit` and
:mod:`~betterbench.demonstrations.making.retarget` (skills, the transits between skills, and their transfer to new
scenes), :mod:`~betterbench.demonstrations.making.amplifier` and :mod:`~betterbench.demonstrations.making.attempt` (one
attempt), :mod:`~betterbench.demonstrations.making.production` (a complete set),
:mod:`~betterbench.demonstrations.making.variety` (how much the demonstrations of a set differ) and
:mod:`~betterbench.demonstrations.making.acceptance` (how many attempts succeeded, and why others failed).
"""
