"""Check that the listed regimes of a task do not contain test conditions."""

from betterbench.errors import InvalidInputError
from betterbench.tasks.authoring.task import Task
from betterbench.tasks.authoring.training_distribution import pairing


def require_no_test(task: Task) -> None:
    """Check that no condition of a listed regime is a test, unless training contains this condition as well.

    A test is the initial scene of a variation together with its instruction.

    Raises:
        InvalidInputError: If a condition is a test. The message names the condition and the test.
    """
    if not task.regimes:
        return
    trained = {pairing(condition) for condition in task.training}
    tests = {}
    for variation in task.variations:
        condition = task.train(variation.base)
        for operation in variation.interventions:
            condition, _ = operation.carry_out(condition)
        tests[pairing(condition)] = variation.name
    for regime, listed in task.regimes.items():
        for number, condition in enumerate(listed.conditions):
            test = tests.get(pairing(condition))
            if test is not None and pairing(condition) not in trained:
                where = f"task {task.id}: regimes.{regime}.conditions[{number}]"
                problem = f"{condition.name} is the test {task.id}/{test}"
                raise InvalidInputError(
                    where, problem, "Change the layout or the instruction of the condition, or remove it"
                )
