"""Construction of a suite of certified tasks from scenarios.

- ``casting``: choice of a catalogue asset for each description of a scenario (``choice``). ``names``: the nouns of
  these objects in instructions. ``look_alikes``: distractors that look like the items.
- ``importing``: import of meshes from a user's catalogue, for descriptions that no library object matches.
- ``proving``: demonstrations and certificate of a task that has not been written to a file yet.
- ``viewing``: check that the front camera shows the scenes of a task completely.
- ``attempts``: repeated attempts to build a task, each with a small change. ``result``: the stored result of the
  attempts.
- ``job``: the resumable job that builds many scenarios and writes the suite's folder.
"""
