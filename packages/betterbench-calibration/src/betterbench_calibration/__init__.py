"""Tools for the maintainers of the diagnosis, installed as a separate package.

- ``independent``: faulty policies with their own controller, written without knowledge of the diagnosis.
- ``family``: measurement of the diagnosis on these policies (`better calibrate --family NAME`).
- ``audit``: checks of the numbers printed in the paper's tables (`better audit-paper`).
- ``mixture``: the paper's mixture of training data, and custom mixtures (`better mixture`).
- ``cli``: the subcommands of ``better`` named above.
"""
