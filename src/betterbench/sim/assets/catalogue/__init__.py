"""Asset catalogue: rows from several sources, searched by words, meaning and filters.

- ``entry``: the row type of the catalogue.
- ``sources``: the procedural library, folders of mesh files, Objaverse; one file each.
- ``encoders``: text encoders for semantic search; the default encoder runs on NumPy.
- ``indexing``: the job that updates rows and vectors, in ``store`` (SQLite) and ``vectors`` (memory-mapped files).
- ``terms``, ``expansion``: normalization of words, and query expansion with the word list ``words.txt``.
- ``kinds``, ``kind_vectors``: kinds of objects with descriptions (``kinds.txt``), and their vectors.
- ``search``: the search; ``variety``: several different assets for one description.

Searching does not need a simulator.
"""
