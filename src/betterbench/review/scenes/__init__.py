"""Human review of the scenes of tasks: moved slots and placement frames, and a verdict for each condition.

- ``changes``: changes of a task with their values before and after, and the lines of the journal.
- ``forms``: a task's JSON form with changes applied, and hashes of tasks and scenes.
- ``queue``: the scenes to review.
- ``desk``: the review logic without the browser page; ``page`` and ``drawing``: the browser page.
- ``writing``: reviewed tasks and assets as new files.
"""
