"""Asset catalogue: a database of assets from several sources.

The catalogue can be searched by words and by meaning, and results can be filtered.

- ``entry``: the type of a catalogue row.
- ``sources``: the sources of assets (the procedural library, folders of mesh files, Objaverse), one file each.
- ``encoders``: text encoders for semantic search. The default encoder runs on NumPy.
- ``indexing``: the job that updates rows and vectors. They are stored in ``store`` (SQLite) and ``vectors``
  (memory-mapped files).
- ``terms``, ``expansion``: normalization of words, and query expansion with the word list ``words.txt``.
- ``kinds``, ``kind_vectors``: kinds of objects with descriptions (``kinds.txt``), and the vectors of the descriptions.
- ``search``: the search. ``variety``: selection of several different assets for one description.

Searching does not need a simulator.
"""
