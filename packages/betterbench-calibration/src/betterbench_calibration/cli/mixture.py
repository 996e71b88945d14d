"""``better mixture``: shares, draws and training budgets of the paper's pre-training mixture or your own."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from betterbench.cli.console import OUT, print_json, print_table, progress_bar, say
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.quoting import json_text

if TYPE_CHECKING:
    from betterbench_calibration.mixture import Budget, FileMixture, MixturePart, MixtureSampler
    from betterbench_calibration.mixture.pretraining import CheckedTotal

_CURE = "Correct the file. docs/mixture.md shows an example"
_BEGINNING = b'{"number": '


def mixture_command(
    file: Annotated[Path | None, tyro.conf.Positional] = None,
    *,
    inside: Literal["items", "equal", "magic-soup-plus"] = "items",
    draws: int = 0,
    out: Path | None = None,
    shard: str = "0/1",
    seed: int | None = None,
    gpus: int | None = None,
    steps: int | None = None,
    tokens_per_gpu: float = 8192.0,
    tokens: tuple[str, ...] = (),
    parameters: float | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Show the paper's pre-training mixture or your own, draw from it, and compute training budgets.

    Without a file, it prints the paper's data sets with recomputed totals, and the budgets of the paper's two runs on
    16 and 24 GPUs. Your own file can list LeRobot data sets and question sets. For such a file, it prints the shares
    and, with --draws, the number of draws from each set. With --out, each draw is written as a line. If the command is
    interrupted, run it again to continue.

    Example: better mixture mixture.yaml --draws 100000

    Args:
        file: YAML file of a mixture. If not given, the paper's mixture is used.
        inside: Rule that divides the draws of actions among the six robot data sets of the paper's mixture: by number
            of frames (items), equally, or by OpenVLA's weights (magic-soup-plus). The paper does not state its rule.
        draws: Total number of draws over all shards.
        out: JSON lines file for this shard's draws.
        shard: Index of this shard and the number of shards, such as 0/4.
        seed: Seed of the draws. If not given, the seed in the file is used.
        gpus: Number of GPUs in the training run whose budget is computed. If not given, the paper's two runs are shown.
        steps: Number of training steps in this run.
        tokens_per_gpu: Number of tokens that one GPU processes in one step.
        tokens: Tokens per sample of a data set, such as DROID=220. For other data sets, they are estimated.
        parameters: Number of model parameters, such as 2e9, to estimate GPU hours.
        overwrite: Replace an existing --out file, even if it does not contain draws of this mixture, seed and shard.
        json: Print one JSON document instead of tables.
    """
    mixture = None if file is None else _of_file(file)
    parts = _parts(mixture, inside)
    chosen = seed if seed is not None else mixture.seed if mixture else 0
    counts = _drawn(mixture, parts, seed=chosen, shard=shard, draws=draws, out=out, overwrite=overwrite)
    budgets = _budgets(
        mixture,
        parts,
        inside,
        gpus=gpus,
        steps=steps,
        tokens_per_gpu=tokens_per_gpu,
        tokens=tokens,
        parameters=parameters,
    )
    if json:
        print_json(_document(mixture, parts, counts, draws, budgets))
    else:
        _print(mixture, parts, counts, draws, budgets)


def _drawn(
    mixture: FileMixture | None,
    parts: Sequence[MixturePart],
    *,
    seed: int,
    shard: str,
    draws: int,
    out: Path | None,
    overwrite: bool,
) -> dict[str, int]:
    """Write the draws to a file if requested. Return the number of draws per data set."""
    from betterbench_calibration.mixture import MixtureSampler

    number, shards = _shard(shard)
    sampler = MixtureSampler(parts, seed=seed, shard=number, shards=shards, draws=draws)
    if out is not None:
        if draws < 1 or mixture is None:
            raise InvalidInputError("--out", "there are no draws to write", "Give a mixture file and --draws")
        _write_draws(out, sampler, mixture, overwrite=overwrite)
        say(f"{len(sampler)} draws of {draws} in {shards} shards written to {out}")
    return sampler.counts(draws) if draws else {}


def _of_file(file: Path) -> FileMixture:
    from betterbench.cli.yaml_file import read_yaml
    from betterbench_calibration.mixture import mixture_of_files

    return mixture_of_files(read_yaml(file, cure=_CURE), where=str(file), folder=file.parent)


def _parts(
    mixture: FileMixture | None, inside: Literal["items", "equal", "magic-soup-plus"]
) -> tuple[MixturePart, ...]:
    from betterbench_calibration.mixture import paper_mixture

    return paper_mixture().parts(inside=inside) if mixture is None else mixture.parts


def _shard(text: str) -> tuple[int, int]:
    number, _, shards = text.partition("/")
    if not all(word.isascii() and word.isdecimal() and len(word) < 7 for word in (number, shards)):
        raise InvalidInputError("--shard", f"{text!r} is not a shard", "Write 0/4 for the first of four")
    return int(number), int(shards)


def _write_draws(out: Path, sampler: MixtureSampler, mixture: FileMixture, *, overwrite: bool) -> None:
    """Write the draws of a shard as lines. If the file already contains lines, verify them and append the others."""
    from betterbench.jobs.durable import on_disk
    from betterbench.jobs.outputs import OutputFile
    from betterbench.jobs.places import open_in_place

    planned = len(sampler)
    lines = (_line(sampler, mixture, index) for index in range(planned))
    with (
        OutputFile(out, "mixture", overwrite=overwrite, is_ours=_holds_draws),
        on_disk(out),
        os.fdopen(open_in_place(out), "r+b") as file,
        progress_bar("draw", planned) as (bar, task),
    ):
        there = True
        for index, line in enumerate(lines):
            if there:
                at = file.tell()
                found = file.readline(len(line))
                if found == line:
                    continue
                begun = line.startswith(found) and not file.read(1)
                if not overwrite and not begun:
                    raise RunConflictError(
                        f"{out}: it contains other data than draws of this mixture, seed and shard "
                        f"(line {index + 1}). Choose a different file, or pass --overwrite."
                    )
                if begun and found:
                    say(f"{out}: its last line was incomplete and is written again")
                there = False
                file.seek(at)
                file.truncate()
            file.write(line)
            if index % 1000 == 0:
                bar.update(task, completed=index)
        if there and file.read(1):
            if not overwrite:
                raise RunConflictError(
                    f"{out}: it contains more than {planned} draws. Choose a different file, or pass --overwrite."
                )
            file.seek(-1, os.SEEK_CUR)
            file.truncate()
        file.flush()
        os.fsync(file.fileno())


def _holds_draws(path: Path) -> bool:
    """Return whether the beginning of a file looks like draws of a mixture."""
    from betterbench.ordinary_file import open_ordinary

    with open_ordinary(path) as file:
        begun = file.read(len(_BEGINNING))
    return _BEGINNING.startswith(begun)


def _line(sampler: MixtureSampler, mixture: FileMixture, index: int) -> bytes:
    """Return the line for a draw, given the index of the draw within the shard."""
    drawn = sampler.own(index)
    place = mixture.sources[drawn.part].place(drawn.item)
    told = {"number": drawn.number, "set": drawn.part, "item": drawn.item, "epoch": drawn.epoch, **place}
    return json_text(told).encode() + b"\n"


def _budgets(
    mixture: FileMixture | None,
    parts: Sequence[MixturePart],
    inside: Literal["items", "equal", "magic-soup-plus"],
    *,
    gpus: int | None,
    steps: int | None,
    tokens_per_gpu: float,
    tokens: Iterable[str],
    parameters: float | None,
) -> dict[str, Budget]:
    """Return the requested budgets, or the budgets of the paper's runs, by name."""
    from betterbench_calibration.mixture import TokenPrices, budget_of, paper_mixture

    if (gpus is None) != (steps is None):
        raise InvalidInputError("--gpus and --steps", "only one of --gpus and --steps is given", "Give both")
    estimates, paper = TokenPrices(), paper_mixture()
    if mixture is None:
        known = {part.name: estimates.of(paper.kind_of(part.group)) for part in parts}
    else:
        known = {
            n: estimates.of("actions" if "LeRobot" in s.kind else "image-text") for n, s in mixture.sources.items()
        }
    known |= _given_tokens(tokens, known)
    if gpus is not None and steps is not None:
        runs = {"run": (parts, gpus, steps)}
    elif mixture is None:
        runs = {run.name: (paper.parts(run.groups, inside), run.gpus, run.steps) for run in paper.runs}
    else:
        runs = {}
    return {
        name: budget_of(drawn, known, gpus=n, steps=s, tokens_per_gpu=tokens_per_gpu, parameters=parameters)
        for name, (drawn, n, s) in runs.items()
    }


def _given_tokens(given: Iterable[str], known: dict[str, float]) -> dict[str, float]:
    from betterbench.errors import UnknownNameError

    found = {}
    for text in given:
        name, _, value = text.rpartition("=")
        if name not in known:
            raise UnknownNameError("data set in --tokens", name, known)
        try:
            found[name] = float(value)
        except ValueError:
            raise InvalidInputError("--tokens", f"expected NAME=NUMBER, got {text!r}", "Write DROID=220") from None
    return found


def _document(
    mixture: FileMixture | None,
    parts: Sequence[MixturePart],
    counts: dict[str, int],
    draws: int,
    budgets: dict[str, Budget],
) -> dict[str, Any]:
    from betterbench_calibration.mixture import paper_mixture

    sets = [asdict(part) | ({"drawn": counts[part.name]} if draws else {}) for part in parts]
    document: dict[str, Any] = {"sets": sets, "budgets": {name: asdict(b) for name, b in budgets.items()}}
    if mixture is None:
        paper = paper_mixture()
        totals = [asdict(total) | {"agrees": total.agrees} for total in paper.totals()]
        document |= {"source": paper.source, "totals": totals}
    return document


def _in_unit(total: CheckedTotal) -> str:
    """Return the sum of the rows as text, in the unit of the printed total."""
    return f"{total.rows / 1e6:,.4f}" if "[million]" in total.what else f"{total.rows:,}"


def _print(
    mixture: FileMixture | None,
    parts: Sequence[MixturePart],
    counts: dict[str, int],
    draws: int,
    budgets: dict[str, Budget],
) -> None:
    from betterbench_calibration.mixture import paper_mixture

    head = ["data set", "group", "items", "share"] + ["drawn", "of draws"] * bool(draws)
    rows = [
        [p.name, p.group, f"{p.items:,}", f"{100 * p.share:.3f} %"]
        + ([f"{counts[p.name]:,}", f"{100 * counts[p.name] / draws:.3f} %"] if draws else [])
        for p in parts
    ]
    print_table(head, rows)
    if mixture is None:
        paper = paper_mixture()
        OUT.print(f"\n{paper.source}; the paper does not print the shares inside a group of actions\n", markup=False)
        print_table(
            ["total", "printed", "sum of the rows", "agrees", ""],
            [[t.what, f"{t.printed:,}", _in_unit(t), "yes" if t.agrees else "no", t.note] for t in paper.totals()],
        )
    for name, budget in budgets.items():
        hours = "" if budget.gpu_hours is None else f", about {budget.gpu_hours:,.0f} GPU hours"
        OUT.print(
            f"\n{name}: {budget.gpus} GPUs, {budget.steps:,} steps: {budget.tokens / 1e9:.1f} billion tokens, "
            f"{budget.batch:.0f} samples a step, {budget.samples / 1e6:.1f} million samples{hours}",
            markup=False,
        )
        print_table(
            ["data set", "samples [million]", "tokens [billion]", "of tokens", "passes"],
            [
                [
                    r.name,
                    f"{r.samples / 1e6:.2f}",
                    f"{r.tokens / 1e9:.2f}",
                    f"{100 * r.token_share:.1f} %",
                    f"{r.passes:.2f}",
                ]
                for r in budget.rows
            ],
        )
    if budgets:
        OUT.print(
            "\nThe tokens per sample and per step are estimates; set them with --tokens and --tokens-per-gpu.",
            markup=False,
        )
