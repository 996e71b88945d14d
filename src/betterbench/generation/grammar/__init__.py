"""Grammar that generates scenarios without a language model.

It consists of themes. A theme is a context with library objects that plausibly occur together.

- ``templates``: the themes of each template, one file each.
- ``theme``: pools of objects, groups, themes, and the registry of grammars.
- ``nouns``: noun phrases of the library's categories, with the sizes and masses of their assets.
- ``author``: seeded random choice of different scenarios.
"""

from betterbench.generation.grammar import templates  # noqa: F401  (imported to register the grammars)
from betterbench.generation.grammar.author import (
    Wanted,
    distinct_goals,
    goal_key,
    grammar_of,
    nouns_of_library,
    write_scenarios,
)

__all__ = ["Wanted", "distinct_goals", "goal_key", "grammar_of", "nouns_of_library", "write_scenarios"]
