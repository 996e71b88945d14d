"""Make demonstrations with a scripted expert, and generate more from them for new initial states.

- ``starts``: choice of the initial states.
- ``manner``: motion styles of the expert.
- ``sources``, ``transit``, ``retarget``: skills, the transits (motions) between skills, and the transfer of both to new
  scenes.
- ``amplifier``, ``attempt``: a single attempt at a demonstration.
- ``production``: a complete set of demonstrations.
- ``variety``, ``acceptance``: differences between demonstrations, acceptance rates of attempts, and reasons for failed
  attempts.
"""
