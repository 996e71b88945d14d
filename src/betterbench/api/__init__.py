"""The functions of the root package: the equivalent of the verbs of ``better`` for Python programs.

- ``runs``: evaluate a policy, open, diagnose and compare runs.
- ``report``: the report of runs, with films rendered from their records.
- ``environments``: tasks as environments, also those of a user's files.

The public names are those of :mod:`betterbench`, which imports them at first use.
"""
