"""``better generate``: write scenarios for a template or a sentence, or grow a suite until it fulfills quotas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.build_options import USUAL_BUILD, ChosenBuild
from betterbench.cli.console import OUT, print_json, print_table, progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from betterbench.generation.folder import Generated


def generate_command(
    target: Annotated[str, tyro.conf.Positional] = "",
    *,
    out: Path,
    num: int | None = None,
    model: str = "offline",
    seed: int = 0,
    tries: int = 3,
    vocabulary: Literal["library", "open"] = "library",
    replay: Path | None = None,
    key_variable: str = "OPENAI_API_KEY",
    build: bool = False,
    until: int | None = None,
    quota: tuple[str, ...] = (),
    quotas: Path | None = None,
    distinct: Literal["categories", "colors"] = "categories",
    unlike: tuple[str, ...] = (),
    max_attempts: int | None = None,
    options: ChosenBuild = USUAL_BUILD,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Write scenarios for a template, or for a sentence. The words of the sentence determine its template.

    A scenario is a setting with an instruction and object descriptions. The offline author needs no model: it combines
    library objects that belong together. The answers of a language model are checked for format and plausibility, and
    problems are sent back to the model. Every exchange is stored in exchanges.jsonl, and --replay uses the stored
    answers instead of the model. Running the command again resumes an interrupted job and produces the same files.

    With --until N, scenarios are drawn, built and certified until the suite has N tasks. Near-duplicates are left out,
    and quotas are respected, such as --quota template=loose_packing:20% axis=temporal:15%. The page growth.html shows
    the quotas, the tasks, and the rejected scenarios. The options from --name on are used only with --until or --build.

    Example: better generate "Pack a picnic into the lunchbox" --num 5 --out picnic

    Args:
        target: Name of a template (`better list templates`), or a sentence in quotes; with --until, all templates if
            not given.
        out: Folder of the scenarios.
        num: Number of scenarios; default: 10 for a template, 1 for a sentence.
        model: "offline", or an OpenAI-compatible chat endpoint with its model, such as
            http://localhost:8000/v1#my-model.
        seed: Seed of the offline author.
        tries: Maximum number of model answers per scenario.
        vocabulary: Objects that a model may use: library objects, or any.
        replay: File exchanges.jsonl of an earlier run. The answers stored in it are used instead of asking a model.
        key_variable: Environment variable with the API key of the endpoint.
        build: Build and certify the tasks in the subfolder "build", as `better build` does.
        until: Add tasks until the suite has this number of certified tasks.
        quota: Quotas PROPERTY=VALUE:AMOUNT for template, axis, context or difficulty; AMOUNT is a minimum (20%, 5) or a
            range (10%-30%, 3-8).
        quotas: YAML or JSON file with quotas.
        distinct: Minimum difference between two tasks: they differ in the category of an object (categories), or in the
            category or color of an object (colors).
        unlike: Reject tasks that nearly duplicate a task of these suites: better60, or suite folders.
        max_attempts: Maximum number of scenarios to build; default: three per task.
        options: Options for building and certifying tasks, used with --until and --build.
        overwrite: Replace files in the output folder that `better generate` did not write.
        json: Print one JSON document instead of a table.
    """
    from betterbench.generation.folder import GenerateSettings, generate_scenarios

    settings = GenerateSettings(target, num, model, seed, tries, vocabulary, replay, key_variable)
    if until is not None:
        from betterbench.cli.verbs.grow import grow_and_tell, read_quotas
        from betterbench.generation.growth.job import GrowSettings

        if build:
            raise InvalidInputError(
                "--build",
                "this option cannot be combined with --until, which already builds the tasks",
                "Leave out --build",
            )
        asked = read_quotas(quota, quotas)
        growing = GrowSettings(until, settings, options.settings, asked, distinct, unlike, max_attempts, options.name)
        grow_and_tell(growing, out, options, overwrite=overwrite, json=json)
        return
    given = {"--quota": quota, "--quotas": quotas, "--unlike": unlike, "--max-attempts": max_attempts}
    _require_unused(given, "--until", "a number of tasks")
    if not target:
        cure = "Pass a template (see `better list templates`), a sentence in quotes, or --until for a suite"
        raise InvalidInputError("better generate", "no template was given", cure)
    with progress_bar(f"scenarios by {model}", settings.count, stays=settings.asks_model) as (bar, shown):
        made = generate_scenarios(
            settings,
            out,
            overwrite=overwrite,
            on_progress=lambda done, _: bar.update(shown, completed=done),
        )
    if not (build and json):
        _tell(made, out, json=json)
    if not made.scenarios:
        first = made.refused[0]
        cure = f"Read {out / 'exchanges.jsonl'}, and choose another model or increase --tries"
        raise InvalidInputError("better generate", f"the model did not write a valid scenario ({first.problem})", cure)
    if build:
        from betterbench.cli.verbs.build import build_command

        build_command((out,), out=out / "build", build=options, overwrite=overwrite, json=json)


def _require_unused(options: Mapping[str, object], needed: str, what: str) -> None:
    """Raise InvalidInputError if an option is given that has no effect without another option."""
    given = next((name for name, value in options.items() if value not in (None, ())), None)
    if given is not None:
        raise InvalidInputError(given, f"this option has no effect without {needed}", f"Add {needed} with {what}")


def _tell(made: Generated, out: Path, *, json: bool) -> None:
    """Print the scenarios, and the numbers of the scenarios for which the model gave no valid answer."""
    from betterbench.generation.scenario_form import scenario_to_json

    if json:
        scenarios = {str(made.files[number]): scenario_to_json(s) for number, s in made.scenarios.items()}
        refused = [{"number": r.number, "tries": r.tries, "problem": r.problem} for r in made.refused]
        print_json({"out": str(out), "template": made.template, "scenarios": scenarios, "refused": refused})
        return
    rows = [
        (
            str(number),
            s.context,
            s.instruction,
            ", ".join(o.instance_name for group in s.groups.values() for o in group),
        )
        for number, s in made.scenarios.items()
    ]
    print_table(("scenario", "context", "instruction", "objects"), rows, title=f"{made.template}:")
    if made.reworded:
        say(f"The instruction differs from your sentence, which {made.reworded}.")
    for left_out in made.refused:
        say(f"scenario {left_out.number} was rejected after {left_out.tries} tries: {left_out.problem}")
    OUT.print(str(out / "scenarios"), markup=False, soft_wrap=True)
