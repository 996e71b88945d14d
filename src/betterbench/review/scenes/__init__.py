"""Human review of the scenes of tasks: moved slots and placement frames, and a verdict for each condition.

- ``changes``: one change of a task, with its value before and after, and the lines of the journal.
- ``forms``: a task's JSON form with changes applied, and hashes of tasks and scenes.
- ``queue``: the scenes to review.
- ``desk``: the review without the browser page; ``page`` and ``drawing``: the page in the browser.
- ``writing``: reviewed tasks and assets as new files.
"""
