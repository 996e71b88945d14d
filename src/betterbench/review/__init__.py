"""Human review of imported objects in the browser, and the agreement between two reviewers.

- ``queue``: the objects to review, each with its review state.
- ``desk``: the state of a review (the current object, the edit in progress and the decisions).
- ``page``: the page in the browser. ``drawing``: rulers and HTML text for the page.
- ``agreement``: Cohen's kappa between two review files.

The decisions are stored and applied to objects by :mod:`betterbench.sim.assets.importing.review`.
"""
