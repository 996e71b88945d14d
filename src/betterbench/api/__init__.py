"""Python API of betterbench. Its functions correspond to subcommands of ``better``.

- ``runs``: evaluate a policy; open, diagnose and compare runs.
- ``report``: write the report of runs, with videos rendered from their records.
- ``environments``: create Gymnasium environments; load tasks and assets from user files.

All public names can be imported from :mod:`betterbench`.
"""
