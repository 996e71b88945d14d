"""Review of imported objects by a person in the browser, and the agreement of two reviewers.

- ``queue``: the objects to review, and what is known of each.
- ``desk``: one review without any page: the object at hand, the edit in progress, and decisions into the journal.
- ``page``: the page in the browser; ``drawing`` makes what it shows.
- ``agreement``: Cohen's kappa of two journals.

The decisions themselves and their replay are in :mod:`betterbench.sim.assets.importing.review`.
"""
