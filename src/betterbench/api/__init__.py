"""Python API of the root package, with functions equivalent to the subcommands of ``better``.

- ``runs``: evaluate a policy, open, diagnose and compare runs.
- ``report``: the report of runs, with films rendered from their records.
- ``environments``: tasks as environments, including the tasks of user files.

The public names are the same as in :mod:`betterbench`, which imports them at first use.
"""
