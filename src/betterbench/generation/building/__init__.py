"""Construction of a suite of certified tasks from scenarios.

- ``casting``: choice of a catalogue asset for each description of a scenario (``choice``). ``names``: the nouns of
  these objects in instructions. ``look_alikes``: distractors that look like the items.
- ``importing``: meshes from a user's catalogue for descriptions that no library object matches.
- ``proving``: demonstrations and certificate of a task that is not yet in a file.
- ``viewing``: framing of the task's scenes by the front camera.
- ``attempts``: the attempts at one task, and the smallest change that helps; ``result``: their stored outcome.
- ``job``: the resumable job over many scenarios, which writes the suite's folder.
"""
