"""Human review of imported objects in the browser, and the agreement between two reviewers.

- ``queue``: the objects to review, each with its review state.
- ``desk``: the logic of a review without the browser page: the current object, the edit in progress, and decisions.
- ``page``: the page in the browser. ``drawing``: rulers and texts for the page.
- ``agreement``: Cohen's kappa between two review files.

The decisions themselves, and their replay, are in :mod:`betterbench.sim.assets.importing.review`.
"""
