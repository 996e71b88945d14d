"""From scenarios to a suite of certified tasks.

- ``casting``: an asset of the catalogue for each description of a scenario (``choice``). ``names``: the nouns of these
  objects in instructions. ``look_alikes``: distractors that look like the items.
- ``importing``: meshes of a user's catalogue for descriptions that no object of the library suits.
- ``proving``: demonstrations and certificate of a task that is not in a file yet, and the smallest change that helps.
- ``viewing``: framing of the task's scenes by the front camera.
- ``attempts``: the attempts at one task; ``result``: what is stored and shown of them.
- ``job``: the resumable job over many scenarios, which writes the suite's folder.
"""
