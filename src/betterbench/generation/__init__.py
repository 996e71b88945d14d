"""From a sentence to a certified task.

- ``scenario``: a template filled in: name, instruction, context, and per group the described objects.
- ``cast``: a scenario with an object of the library for each description.
- ``patterns``: one file per template, which turns a cast into a task with training conditions and variations.
- ``better_release``: import and audit of tasks in the format of the BeTTER release.
"""
