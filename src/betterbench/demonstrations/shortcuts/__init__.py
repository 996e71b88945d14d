"""Shortcut audit: associations that a policy could exploit, and the variations that it would then fail.

- ``facts``, ``questions``, ``association``, ``words``, ``instructions``, ``pairs``: the tested variables, and the tests
  of their associations.
- ``examine``, ``prediction``, ``smallest``, ``asked``: the audit, the predicted failures, and the smallest shortcut
  that the audit would detect.
- ``lerobot``, ``lerobot_files``, ``lerobot_order``, ``lerobot_choice``: reading LeRobot data sets; ``numbers``,
  ``grips`` and ``places`` interpret their columns.
- ``reading``, ``shown``, ``page``: description of the data, and the result as Markdown.
"""
