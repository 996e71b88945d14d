"""Growth of a suite to a number of certified tasks under quotas.

- ``quotas``: shares of templates, axes, contexts and difficulties, and their contradictions.
- ``likeness``: keys of near-duplicates; ``difficulty``: levels of certified tasks.
- ``sources``: authors of the next scenario, offline or a language model.
- ``steering``: choice of the next template and context, and acceptance of certified tasks.
- ``proposals``: journal of the proposed scenarios; ``job``: the resumable job; ``result``: its outcome.
"""
