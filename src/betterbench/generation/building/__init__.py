"""From scenarios to a suite of certified tasks.

- ``casting``: an asset of the catalogue for each description of a scenario, and look-alikes of the items.
- ``proving``: demonstrations and certificate of a task that is not in a file yet, and the smallest change that helps.
- ``viewing``: framing of the task's scenes by the front camera.
- ``attempts``: the attempts at one task; ``result``: what is stored and shown of them.
- ``job``: the resumable job over many scenarios, which writes the suite's folder.
"""
