"""Functions of the root package, equivalent to the verbs of ``better``, for Python programs.

- ``runs``: evaluate a policy, open, diagnose and compare runs.
- ``report``: the report of runs, with films rendered from their records.
- ``environments``: tasks as environments, including the tasks of user files.

The public names are the same as in :mod:`betterbench`, which imports them at first use.
"""
