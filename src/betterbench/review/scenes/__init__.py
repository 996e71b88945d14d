"""Human review of the scenes of tasks.

Reviewers can move slots and placement frames, and give a verdict on each condition.

- ``changes``: changes to a task, each with the values before and after it, and the lines of the review file.
- ``forms``: applies changes to the JSON form of a task, and computes hashes of tasks and scenes.
- ``queue``: the scenes to review.
- ``desk``: the logic of a review without the browser page. ``page`` and ``drawing`` contain the page.
- ``writing``: writes reviewed tasks and assets to new files.
"""
