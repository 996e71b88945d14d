"""Tools for maintainers of the diagnosis, in a separate distribution.

- ``independent``: faulty policies with a separate controller and habits, written without knowledge of the diagnosis;
  ``family`` measures the diagnosis on them (`better calibrate --family NAME`).
- ``audit``: checks of the numbers printed in the paper's tables (`better audit-paper`).
- ``mixture``: the paper's mixture of training data, and custom mixtures (`better mixture`).
- ``cli``: these verbs.
"""
