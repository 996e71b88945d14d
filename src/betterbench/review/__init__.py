"""Human review of imported objects in the browser, and the agreement between two reviewers.

- ``queue``: the objects to review, each with its review state.
- ``desk``: the review logic without the browser page: current object, edit in progress, and decisions.
- ``page``: the page in the browser; ``drawing``: rulers and texts of the page.
- ``agreement``: Cohen's kappa of two journals.

The decisions themselves and their replay are in :mod:`betterbench.sim.assets.importing.review`.
"""
