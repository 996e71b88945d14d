"""Generation of certified tasks from templates and sentences.

- ``scenario``: a filled-in template, with a name, an instruction, a context, and described objects for each group.
- ``scenario_form``: scenarios as JSON. ``sense``, ``instruction_sense``: plausibility checks of scenarios, based on the
  nouns in ``vocabulary``.
- ``grammar``: the author of scenarios that needs no language model. ``choosing``: chooses a template and objects that
  match a user's sentence.
- ``asking``: scenarios written by a language model, with corrections and stored exchanges.
- ``folder``: the scenario folder written by ``better generate``.
- ``cast``: scenarios with a library object chosen for each description.
- ``patterns``: one file per template. Each file turns a cast into a task with training conditions and variations.
- ``better_release``: import and audit of tasks in the format of the BeTTER release.
"""
