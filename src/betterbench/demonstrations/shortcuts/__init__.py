"""Shortcut audit: associations that a policy could exploit, and the variations that it would then fail.

- ``facts``, ``questions``, ``association``, ``words``, ``instructions``, ``pairs``: the tested variables, and the tests
  for associations between them.
- ``examine``, ``prediction``, ``smallest``, ``asked``: the audit, the predicted failures, the smallest shortcut that
  the audit would detect, and the tested questions.
- ``lerobot``, ``lerobot_files``, ``lerobot_order``, ``lerobot_choice``: reading LeRobot data sets; ``numbers``,
  ``grips`` and ``places`` interpret their columns.
- ``reading``, ``shown``, ``page``: description of the data, and the result as Markdown.
"""
