"""Shortcut audit: associations in demonstrations, and the variations that a learner that uses them would fail.

- ``facts``, ``questions``, ``association``, ``words``, ``instructions``, ``pairs``: the tested variables and their
  associations.
- ``examine``, ``prediction``, ``smallest``, ``asked``: the audit, the predicted failures, and the sensitivity.
- ``lerobot``, ``lerobot_files``, ``lerobot_order``, ``lerobot_choice``: LeRobot data sets; ``numbers``, ``grips`` and
  ``places`` read their columns.
- ``reading``, ``shown``, ``page``: description of the data, and the result as Markdown.
"""
