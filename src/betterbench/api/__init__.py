"""Python API of the package, with functions that do the same as the subcommands of ``better``.

- ``runs``: evaluate a policy; open, diagnose and compare runs.
- ``report``: write the report of runs, with films rendered from their records.
- ``environments``: use tasks as environments, including tasks defined in user files.

The public names are also available in :mod:`betterbench`, which imports them when they are first used.
"""
