"""``better generate``: scenarios of a template or about a sentence."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_table, progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.generation.folder import Generated


def generate_command(
    target: Annotated[str, tyro.conf.Positional],
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
    catalogue: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Write scenarios of a template, or scenarios for a sentence, whose words choose the template.

    A scenario is a context with an instruction and described objects. The offline author needs no model: it combines
    objects of the library that belong together. The answers of a language model are checked for form and plausibility,
    and problems are sent back to the model. Every exchange is stored in exchanges.jsonl, and --replay uses the stored
    answers instead of the model. The same command gives the same files, and resumes after an interruption.

    Example: better generate "Pack a picnic into the lunchbox" --num 5 --out picnic

    Args:
        target: Name of a template (better list templates), or a sentence in quotes.
        out: Folder of the scenarios.
        num: Number of scenarios; by default, 10 of a template, or one for a sentence.
        model: "offline", or a chat endpoint with OpenAI's protocol and its model, as
            http://localhost:8000/v1#my-model.
        seed: Seed of the offline author.
        tries: Number of answers of a model per scenario.
        vocabulary: Objects that a model may use: those of the library, or any.
        replay: File exchanges.jsonl of an earlier run, with the answers to use instead of a model.
        key_variable: Environment variable with the key of the endpoint.
        build: Build and certify the tasks in the subfolder "build", with the defaults of better build.
        catalogue: With --build: catalogue of better assets index, to import objects that are missing in the library.
        overwrite: Replace files in the folder that better generate did not write.
        json: Print one JSON document instead of a table.
    """
    from betterbench.generation.folder import GenerateSettings, generate_scenarios

    settings = GenerateSettings(target, num, model, seed, tries, vocabulary, replay, key_variable)
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
        cure = f"Read {out / 'exchanges.jsonl'}, and try another model or more --tries"
        raise InvalidInputError(
            "better generate", f"the model wrote no scenario that makes sense ({first.problem})", cure
        )
    if build:
        from betterbench.cli.verbs.build import build_command

        build_command((out,), out=out / "build", catalogue=catalogue, overwrite=overwrite, json=json)


def _tell(made: Generated, out: Path, *, json: bool) -> None:
    """Print the scenarios, and the scenarios without a valid answer from the model."""
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
        say(f"The instruction is not your sentence, which {made.reworded}.")
    for left_out in made.refused:
        say(f"scenario {left_out.number} was rejected after {left_out.tries} tries: {left_out.problem}")
    OUT.print(str(out / "scenarios"), markup=False, soft_wrap=True)
