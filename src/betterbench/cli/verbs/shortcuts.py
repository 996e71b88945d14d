"""``better shortcuts``: find shortcuts in a dataset, and predict which variations a learner will fail."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from betterbench.cli.console import OUT, passing_bar, print_item, print_json, print_table, progress_bar, say
from betterbench.errors import InvalidInputError

if TYPE_CHECKING:
    from betterbench.demonstrations.making.variety import TaskVariety
    from betterbench.demonstrations.shortcuts.examine import GroupAudit, ShortcutAudit
    from betterbench.demonstrations.shortcuts.facts import EpisodeFacts
    from betterbench.demonstrations.shortcuts.prediction import Prediction
    from betterbench.demonstrations.shortcuts.reading import DataReading


def shortcuts_command(
    data: Annotated[Path, tyro.conf.Positional],
    *,
    instruction: str | None = None,
    gripper: tuple[str, ...] = (),
    place: tuple[str, ...] = (),
    closed: Literal["auto", "low", "high"] = "auto",
    seed: int = 0,
    out: Path | None = None,
    sign: Path | None = None,
    overwrite: bool = False,
    json: bool = False,
) -> None:
    """Find shortcuts in demonstrations: words or objects that predict positions, steps or targets better than chance.

    If DATA is a run, the initial object positions, the order of picks and placements, and the variety of the
    demonstrations are read from the recorded states. If it is a LeRobot dataset (2.0 to 3.0), instructions, actions and
    proprioception are read. The audit checks whether words, word pairs or complete instructions predict where the
    gripper first closes, where it last opens, in which direction it first moves, or in which order it visits its
    targets. The command first prints the columns that it uses. If it cannot infer them from their names, use
    --instruction, --gripper, --place and --closed (COLUMN:NAME, COLUMN[3], COLUMN[0,1,2], or COLUMN for the whole
    column).

    For runs, each rule is compared with the variations. A variation that breaks a rule distinguishes a policy that
    follows the instruction from a policy that follows the rule. The result is a prediction: the variations ranked by
    the risk that a learner trained on this dataset fails them, with the expected label.

    Example: better shortcuts runs/demonstrations --out audit

    Args:
        data: Folder of a run or a LeRobot dataset.
        instruction: Column with the instructions in a LeRobot dataset: a frame column (strings or task indices), or a
            column of meta/tasks.
        gripper: Component with the gripper opening, such as action:gripper; one per arm.
        place: Components of the gripper position, x first, such as observation.state[0,1,2]; one set for each
            --gripper, in the same order. With a leading +, the components are displacements and are summed.
        closed: End of the gripper's range at which it is closed; auto infers it from names and values, or fails if it
            cannot be inferred.
        seed: Seed for the sample of episodes that is drawn if the dataset has more than 5,000.
        out: Folder for shortcuts.json, shortcuts.md and, for runs, prediction.json.
        sign: Private SSH key with which prediction.json is signed.
        overwrite: Write even to a folder that `better shortcuts` did not make, and replace files with the same names
            there.
        json: Print the audit as one JSON document.
    """
    from betterbench.jobs.outputs import OutputFolder

    if sign is not None and out is None:
        raise InvalidInputError("--sign", "without --out, there is no file to sign", "Add --out FOLDER")
    choices = {
        "instruction": instruction,
        "grippers": gripper,
        "places": place,
        "closed": None if closed == "auto" else closed,
        "seed": seed,
    }
    with nullcontext() if out is None else OutputFolder(out, "shortcuts", overwrite=overwrite):
        facts, audit, prediction = _audited(data, choices)
        if out is not None:
            _write(out, audit, prediction, sign)
    if json:
        print_json(audit.to_json() | {"variety": [asdict(task) for task in _variety_of(data)]})
        return
    _print(facts, audit, prediction, out)
    _tell_variety(data)


def _print(
    facts: tuple[EpisodeFacts, ...], audit: ShortcutAudit, prediction: Prediction | None, out: Path | None
) -> None:
    """Print the description of the data, and the shortcuts that were found."""
    if audit.reading is not None:
        print_item(audit.reading.paragraph)
    for group in audit.groups:
        if len({fact.instruction for fact in facts if fact.group == group.group}) < 2:
            say(f"{group.group} has only one instruction, so it cannot show whether a policy follows instructions")
        for note in group.notes:
            say(f"{group.group}: {note}")
    _tell(audit, prediction)
    if out is not None:
        OUT.print(f"written to {out}", markup=False, soft_wrap=True)


def _audited(data: Path, choices: dict[str, Any]) -> tuple[tuple[EpisodeFacts, ...], ShortcutAudit, Prediction | None]:
    """Return the facts about the demonstrations, the shortcut audit, and the prediction for the variations."""
    from betterbench.demonstrations.shortcuts.examine import audit_dataset
    from betterbench.demonstrations.shortcuts.prediction import predict
    from betterbench.tasks import task_names

    facts, hashed, reading = _facts_of(data, choices)
    audit = audit_dataset(str(data), facts, reading)
    known = {group.group for group in audit.groups} & set(task_names())
    return facts, audit, predict(audit, dataset_sha256=hashed) if known else None


def _facts_of(data: Path, choices: dict[str, Any]) -> tuple[tuple[EpisodeFacts, ...], str, DataReading]:
    """Return the facts about each demonstration, the hash of the set, and a description of the data that were read.

    For a LeRobot dataset, the hash is an empty string.
    """
    from betterbench.demonstrations.making.production import set_hash
    from betterbench.demonstrations.shortcuts.lerobot import Choices, is_lerobot_dataset, read_lerobot
    from betterbench.demonstrations.shortcuts.shown import facts_of_run, reading_of_run
    from betterbench.records import RunFolder

    if is_lerobot_dataset(data):
        found = read_lerobot(data, Choices(**choices))
        return found.facts, "", found.reading
    folder = _run_in(data)
    if not (folder / "run.json").exists():
        problem = "the folder is neither a run nor a LeRobot dataset"
        raise InvalidInputError(str(data), problem, "Pass a folder with run.json, or with meta/info.json")
    for option in ("instruction", "grippers", "places", "closed"):
        if choices[option]:
            problem = f"this option applies only to LeRobot datasets, and {data} is a run"
            raise InvalidInputError(f"--{option.removesuffix('s')}", problem, "Leave out this option")
    run = RunFolder.open(folder)
    entries = list(run.entries())
    trials = [e.key for e in entries if e.status == "done" and run.succeeded(e.key, e)]
    facts = []
    with progress_bar("read", len(trials), stays=False) as (bar, shown):
        for _, fact in facts_of_run(run, trials):
            facts.append(fact)
            bar.update(shown, completed=len(facts))
    return tuple(facts), set_hash(run), reading_of_run(facts, len(entries))


def _run_in(data: Path) -> Path:
    """Return the run folder inside a folder written by `better dataset`. Any other folder is returned unchanged."""
    return data / "demonstrations" if (data / "recipe.json").exists() else data


def _variety_of(data: Path) -> tuple[TaskVariety, ...]:
    """Return the variety of the demonstrations of a run, by task.

    Return an empty result for a LeRobot dataset.
    """
    from betterbench.demonstrations.making.variety import variety_of_run
    from betterbench.records import RunFolder

    if not (_run_in(data) / "run.json").exists():
        return ()
    with passing_bar("comparing the demonstrations") as told:
        return variety_of_run(RunFolder.open(_run_in(data)), on_progress=told)


def _tell_variety(data: Path) -> None:
    from betterbench.cli.output.demonstrations import tell_variety

    tell_variety(_variety_of(data))


def _write(out: Path, audit: ShortcutAudit, prediction: Prediction | None, key: Path | None) -> None:
    from betterbench.demonstrations.shortcuts.page import audit_lines, doubt, prediction_lines
    from betterbench.demonstrations.shortcuts.prediction import sign, write_prediction
    from betterbench.jobs import write_durably
    from betterbench.quoting import json_text

    text = json_text(audit.to_json(), indent=1) + "\n"
    lines = ["# Shortcuts", "", *audit_lines(audit)]
    write_durably(out / "shortcuts.json", text.encode())
    if prediction is not None:
        doubts = [f"{said}.", ""] if (said := doubt(audit, prediction)) else []
        lines += ["## Prediction", "", *doubts, *prediction_lines(prediction)]
        write_prediction(out / "prediction.json", prediction)
        if key is not None:
            sign(out / "prediction.json", key)
    write_durably(out / "shortcuts.md", ("\n".join(lines).rstrip() + "\n").encode())


def _tell_asked(group: GroupAudit) -> None:
    """Print the questions that the audit tested for a group of demonstrations, and the questions it could not test.

    Rules that only reflect the meaning of words are printed too, with a note that they are not shortcuts.
    """
    from betterbench.demonstrations.shortcuts.asked import tested_text, untested_text

    print_item(f"tested in {group.group}: {tested_text(group.asked)}")
    if untested := untested_text(group.asked):
        print_item(f"not tested in {group.group}: {untested}")
    for f in group.findings:
        if f.meaning:
            print_item(f"not a shortcut, because {f.meaning}: {'; '.join(f.rules)}")


def _tell(audit: ShortcutAudit, prediction: Prediction | None) -> None:
    from betterbench.demonstrations.shortcuts.page import doubt
    from betterbench.demonstrations.shortcuts.smallest import shares_line
    from betterbench.wording import plural

    rows = []
    for group in audit.groups:
        for f in group.shortcuts:
            p = "–" if f.p_adjusted is None else f"{f.p_adjusted:.4f}"
            broken = ", ".join(name for name, _ in f.separating) or "–"
            rows.append((group.group, f.title, f"{f.strength:.2f}", p, broken))
    if rows:
        print_table(("group", "association", "strength", "p", "broken by"), rows)
        OUT.print("rules:", markup=False)
    for group in audit.groups:
        for f in group.shortcuts:
            print_item(f"{group.group}, {f.title}: {'; '.join(f.rules[:2])}", indent=2)
    count = sum(group.episodes for group in audit.groups)
    groups = plural(len(audit.groups), "group")
    OUT.print(f"{plural(len(rows), 'shortcut')} in {plural(count, 'demonstration')} of {groups}", markup=False)
    for group in audit.groups:
        _tell_asked(group)
    print_item("smallest detectable rule, as a fraction of the demonstrations:")
    for group in audit.groups:
        shown = shares_line(group.smallest) or "no question could be tested, because the demonstrations do not differ"
        print_item(f"{group.group} ({plural(group.episodes, 'demonstration')}): {shown}", indent=2)
    if prediction is not None:
        at_risk = [f for f in prediction.variations if f.risk > 0.0]
        likeliest = ", ".join(f"{f.task}/{f.variation} ({f.label}, {f.risk:.2f})" for f in at_risk[:5]) or "none"
        said = f"variations at risk: {len(at_risk)} of {len(prediction.variations)}, most likely: {likeliest}"
        print_item(said)
        if unsure := doubt(audit, prediction):
            print_item(unsure)
