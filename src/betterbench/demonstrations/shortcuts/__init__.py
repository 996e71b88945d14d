"""The shortcut audit: what goes together in demonstrations, and which variations a learner of them would fail.

- ``facts``, ``questions``, ``association``, ``words``, ``instructions``, ``pairs``: what is looked at, and what goes
  together.
- ``examine``, ``prediction``, ``smallest``, ``asked``: the audit, the failures that it predicts, and what it cannot
  find.
- ``lerobot``, ``lerobot_files``, ``lerobot_order``, ``lerobot_choice``: data sets of LeRobot; ``numbers``, ``grips``
  and ``places`` read their columns.
- ``reading``, ``shown``, ``page``: how data were read, and the result as Markdown.
"""
