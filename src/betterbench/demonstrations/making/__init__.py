"""Make demonstrations with a scripted expert, and generate more from them for new initial states.

- ``starts``: choice of the initial states.
- ``manner``: motion styles of the expert.
- ``sources``, ``transit``, ``retarget``: skills, the transits between skills, and their transfer to new scenes.
- ``amplifier``, ``attempt``: a single attempt at a demonstration.
- ``production``: a complete set of demonstrations.
- ``variety``, ``acceptance``: how much demonstrations differ, how many attempts succeeded, and why others failed.
"""
