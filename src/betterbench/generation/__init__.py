"""From a sentence to a certified task.

- ``scenario``: a filled-in template: name, instruction, context, and described objects for each group.
- ``scenario_form``: the JSON form of scenarios. ``sense``, ``instruction_sense``: checks beyond the form, with nouns of
  ``vocabulary``.
- ``grammar``: the offline author of scenarios. ``choosing``: template and objects from a sentence.
- ``asking``: scenarios by a language model, with corrections and stored exchanges.
- ``folder``: a folder of scenarios, as ``better generate`` writes it.
- ``cast``: a scenario with an object of the library for each description.
- ``patterns``: one file per template, which turns a cast into a task with training conditions and variations.
- ``better_release``: import and audit of tasks in the format of the BeTTER release.
"""
