"""Tasks of the suite, with one short file each. New files in this folder are found automatically."""

from betterbench.errors import import_registering
from betterbench.tasks.authoring.registry import places_of_tasks

import_registering(__name__, __path__[0], places_of_tasks, "Decorate the function that returns the task with @a.task")
