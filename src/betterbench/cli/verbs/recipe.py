"""``better recipe``: write the configuration and commands to train a policy in another framework."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_table, say

if TYPE_CHECKING:
    from betterbench.demonstrations.recipes import Recipe


def recipe_command(
    framework: Annotated[Literal["openpi", "gr00t", "being-h", "lerobot"], tyro.conf.Positional],
    *,
    recipe: str = "better",
    data: tuple[str, ...] = (),
    out: Path | None = None,
    gpus: int | None = None,
    weights: str | None = None,
    policy: str = "pi05",
    sample_tokens: int = 220,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Write the configuration and commands to train pi0.5, GR00T, Being-H or a LeRobot policy with a recipe.

    Use one of the recipes from the BeTTER paper (better, libero, calvin, real_arm) or your own file. The output folder
    contains the configuration, all commands from the training to the evaluation, and a table that states where each
    value comes from. If the data set written by `better export` is on this machine, it is checked.

    Example: better recipe openpi --data sets/pi --out recipes/pi

    Args:
        framework: Training framework.
        recipe: Name of a recipe from the BeTTER paper, or a YAML file.
        data: Folder of the data set, here or on the training machine; several for Being-H.
        out: Folder to write; if not given, the fields are printed.
        gpus: Number of GPUs; by default 4, and 1 for real_arm.
        weights: Initial weights; default: the framework's published weights.
        policy: Type of policy for LeRobot: act, diffusion, multi_task_dit, smolvla, pi0 or pi05.
        sample_tokens: Number of tokens per sample; Being-H uses it to pack its sequences.
        overwrite: Write even to a folder that `better recipe` did not make, and replace files with the same names
            there.
        json: Print one JSON document instead of a table.
    """
    from betterbench.demonstrations.recipes import setup_files, trainer_setup, write_setup

    chosen = _recipe(recipe)
    # The commands are run in the folder of the framework.
    places = [str(Path(place).absolute()) if Path(place).exists() else place for place in data]
    setup = trainer_setup(
        framework, chosen, places, gpus=gpus, weights=weights, policy=policy, sample_tokens=sample_tokens
    )
    files = setup_files(setup, chosen)
    if out is not None:
        write_setup(files, out, overwrite=overwrite)
    if json:
        fields = [asdict(setting) for setting in setup.settings]
        print_json({"framework": framework, "fields": fields, "files": sorted(files), "evaluate": setup.evaluation})
        return
    if out is None:
        print_table(
            ["field", "value", "decided by", "where"],
            [[s.name, str(s.value), s.origin, s.where] for s in setup.settings],
        )
    for text in setup.checks:
        say(f"- {text}")
    if out is not None:
        OUT.print(f"written to  {out}: {', '.join(sorted(files))}", markup=False, soft_wrap=True)
    OUT.print(f"evaluate    {setup.evaluation}", markup=False, soft_wrap=True)


def _recipe(text: str) -> Recipe:
    from betterbench.cli.yaml_file import read_yaml
    from betterbench.demonstrations.recipes import recipe_of

    if not text.endswith((".yaml", ".yml")):
        return recipe_of(text)
    return recipe_of(read_yaml(Path(text), cure="Correct the recipe; docs/recipes.md shows one"), where=text)
