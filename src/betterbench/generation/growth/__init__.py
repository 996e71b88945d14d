"""Growth of a suite under quotas, until it has a requested number of certified tasks.

- ``quotas``: minimum and maximum amounts for templates, axes, contexts and difficulties; detection of contradictions.
- ``likeness``: keys that are equal for near-duplicate tasks. ``difficulty``: levels of difficulty of certified tasks.
- ``sources``: authors that propose the next scenario: the grammar or a language model.
- ``steering``: choice of the next template and context, and acceptance of certified tasks.
- ``proposals``: journal of the proposed scenarios. ``job``: the resumable job. ``result``: its outcome.
"""
