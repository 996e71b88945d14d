"""The functions of the root package: what Python programs call where a shell calls ``better``.

- ``runs``: evaluate a policy, open, diagnose and compare runs.
- ``report``: the report of runs, with films that are rendered from their records.
- ``environments``: tasks as environments, also those of a user's files.

The public names are those of :mod:`betterbench`, which imports them when they are first used.
"""
