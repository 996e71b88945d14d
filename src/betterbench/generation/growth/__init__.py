"""Growth of a suite under quotas, until it has a requested number of certified tasks.

- ``quotas``: minimum and maximum amounts of templates, axes, contexts and difficulties; detection of contradictions.
- ``likeness``: keys of near-duplicates; ``difficulty``: levels of certified tasks.
- ``sources``: authors of the next scenario, offline or a language model.
- ``steering``: choice of the next template and context, and acceptance of certified tasks.
- ``proposals``: journal of the proposed scenarios; ``job``: the resumable job; ``result``: its outcome.
"""
