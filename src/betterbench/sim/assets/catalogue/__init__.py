"""Asset catalogue: rows from several sources, searched by words, meaning and filters.

- ``entry``: the row, and the names of licenses.
- ``sources``: the procedural library, folders of mesh files, Objaverse; one file each.
- ``encoders``: encoders of meaning; the default encoder runs on NumPy.
- ``indexing``: the job that brings rows and vectors up to date, in ``store`` (SQLite) and ``vectors`` (mapped files).
- ``terms``, ``expansion``: normal form of words, and expansion of queries with the word list ``words.txt``.
- ``kinds``, ``kind_vectors``: kinds of objects with descriptions (``kinds.txt``), and their vectors.
- ``search``: the search; ``variety``: several different assets for one description.

Searching starts no simulator.
"""
