"""Update the task version in the packaged calibration, for a task whose trials have not changed.

    better calibrate --tasks fast_food --out BEFORE      # with the old version of the task
    better calibrate --tasks fast_food --out AFTER       # with the new version
    python tools/carry_calibration.py BEFORE AFTER

If only a rule of the goal has changed, and neither scene nor instruction, AFTER is not needed. Without it, the states
of every record of BEFORE are judged again with the new rules, and all verdicts must be the recorded ones.

If only the wording of instructions has changed (and perhaps a rule), part of AFTER is enough::

    python tools/carry_calibration.py BEFORE --sample AFTER

The faulty policies decide by the steps of an instruction and by whether two instructions are the same. Equal
instructions must therefore stay equal in the new wording, and different instructions must stay different. The states of
BEFORE are judged again as above. AFTER must contain at least one trial of each condition, and each of its records must
contain the same bytes as the record of the same trial in BEFORE.

A label may depend on all trials of a policy, so the counts of one task cannot be replaced by new ones. If every record
contains the same bytes under both versions, all labels stay the same, and only the versions in the file have to change.
If a record differs, the whole calibration has to be measured again.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

import compare_records
from betterbench.diagnosis import Calibration
from betterbench.diagnosis.measures.confusion import packaged_file
from betterbench.diagnosis.trial import offline_truth
from betterbench.errors import BetterError, InvalidInputError
from betterbench.jobs import write_durably
from betterbench.records import Record, read_record
from betterbench.tasks import get_task

CURE = "Measure the whole calibration with better calibrate --write-package"
TASK = "task_version:"


def main(arguments: Sequence[str] | None = None) -> int:
    """Check both folders and rewrite the versions of the packaged calibration; return 2 if anything differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("before", type=Path, help="folder of better calibrate, with the old version")
    parser.add_argument("after", type=Path, nargs="?", help="folder of the same command, with the new version")
    parser.add_argument(
        "--sample", type=Path, default=None, help="some trials with the new wording of the instructions"
    )
    parser.add_argument("--file", type=Path, default=None, help="calibration to rewrite; by default, the packaged one")
    asked = parser.parse_args(arguments)
    if asked.after is not None and asked.sample is not None:
        parser.error("give either AFTER or --sample")
    with resources.as_file(resources.files("betterbench.diagnosis").joinpath("data")) as folder:
        file = asked.file or folder / packaged_file("faulty")
    try:
        carried = carry(read(file), asked.before, asked.after, sample=asked.sample)
    except BetterError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    write_durably(file, carried.file_bytes())
    sys.stdout.write(f"{file}: {', '.join(f'{k} {v}' for k, v in carried.versions.items() if k.startswith(TASK))}\n")
    return 0


def read(file: Path) -> Calibration:
    """Return the calibration in a file."""
    if not file.is_file():
        raise InvalidInputError(str(file), "it does not exist", "Run better calibrate into this folder")
    return Calibration.from_json(file.read_bytes(), where=str(file))


def carry(packaged: Calibration, before: Path, after: Path | None, *, sample: Path | None = None) -> Calibration:
    """Return the packaged calibration with the task versions of ``after``, or of the present tasks if it is None.

    Raises:
        InvalidInputError: If ``before`` was measured under other versions or with other policies than the packaged
            calibration; if anything but a task's version differs between the two folders; if ``after`` is None and a
            record of ``before`` is judged differently now; or if a record of ``sample`` differs.
    """
    old = read(before / "calibration.json")
    for name, version in old.versions.items():
        if packaged.versions.get(name) != version:
            raise InvalidInputError(str(before), f"{name} is {version}, packaged: {packaged.versions.get(name)}", CURE)
    if old.policies.keys() != packaged.policies.keys():
        other = sorted(old.policies.keys() ^ packaged.policies.keys())
        raise InvalidInputError(str(before), f"the policies differ: {', '.join(other)}", CURE)
    trials = old.total + old.left_out
    if after is None:
        _require_same_verdicts(before, trials=trials)
        if sample is not None:
            _require_same_sample(before, sample)
        tasks = {n: str(get_task(n.removeprefix(TASK)).version) for n in old.versions if n.startswith(TASK)}
    else:
        new = read(after / "calibration.json")
        _require_same_labels(old, new, after)
        _require_same_records(before, after, trials=trials)
        tasks = {name: version for name, version in new.versions.items() if name.startswith(TASK)}
    return replace(packaged, versions={**packaged.versions, **tasks})


def _require_same_labels(old: Calibration, new: Calibration, after: Path) -> None:
    """Raise InvalidInputError if a label or a version differs, except versions of tasks."""
    for name, version in old.versions.items():
        if not name.startswith(TASK) and new.versions.get(name) != version:
            raise InvalidInputError(str(after), f"{name} is {new.versions.get(name)}, expected {version}", CURE)
    if replace(new, versions={}) != replace(old, versions={}):
        raise InvalidInputError(str(after), "the labels differ from those of the old version", CURE)


def _require_same_verdicts(before: Path, *, trials: int) -> None:
    """Raise InvalidInputError if a record's states are judged differently now, or if there are too few records."""
    same = 0
    for path in sorted(before.glob("*/records/**/*.parquet")):
        if not has_same_verdicts(read_record(path)):
            raise InvalidInputError(str(path), "its states are judged differently with the new version", CURE)
        same += 1
    _require_all(before, same, trials)


def has_same_verdicts(record: Record) -> bool:
    """Return whether every state of a record gets the recorded verdicts when it is judged with the present rules.

    The relations cover all objects at the instructed targets. Policies and the diagnosis read the targets through these
    relations. A trial whose verdicts are the same in every state therefore takes the same course and gets the same
    label.
    """
    truths = offline_truth(record)
    columns = {
        "predicates": [t.relations for t in truths],
        "subgoals": [t.subgoals for t in truths],
        "goal": [t.goal for t in truths],
        "forbidden": [t.forbidden for t in truths],
    }
    recorded = record.arrays()
    same = all(np.array_equal(recorded[name], np.array(values)) for name, values in columns.items())
    return same and record.outcome.success == any(t.success for t in truths)


def _require_same_sample(before: Path, sample: Path) -> None:
    """Raise InvalidInputError unless the records of a sample have the same bytes and differ only in their wording."""
    pairs: set[tuple[str, str]] = set()
    conditions: dict[bool, set[str]] = {True: set(), False: set()}
    for path in sorted(before.glob("*/records/**/*.parquet")):
        other, known = sample / path.relative_to(before), read_record(path).metadata
        conditions[other.is_file()].add(f"{known.task}/{known.condition}")
        if not other.is_file():
            continue
        if (column := compare_records.first_difference(pq.read_table(path), pq.read_table(other))) is not None:
            raise InvalidInputError(str(other), f"{column} differs from the old version", CURE)
        pairs.add((f"{known.task}: {known.instruction}", f"{known.task}: {read_record(other).metadata.instruction}"))
    if missing := sorted(conditions[False] - conditions[True]):
        problem = f"it has no trial of {', '.join(missing)}"
        raise InvalidInputError(str(sample), problem, "Continue better calibrate in this folder")
    for texts in zip(*pairs, strict=True):
        twice = next((text for text, times in Counter(texts).items() if times > 1), None)
        if twice is not None:
            raise InvalidInputError(str(sample), f"two instructions correspond to one: {twice!r}", CURE)


def _require_same_records(before: Path, after: Path, *, trials: int) -> None:
    """Raise InvalidInputError if a record of ``before`` is missing or differs in ``after``, or if there are too few."""
    same = 0
    for name, old, new in compare_records.runs(before, after, ()):
        found = compare_records.compare(old, new, ())
        if found.missing or found.changed:
            problem = f"{name}: {(found.missing + found.changed)[0]} differs from the old version"
            raise InvalidInputError(str(after), problem, CURE)
        same += found.same
    _require_all(before, same, trials)


def _require_all(before: Path, found: int, trials: int) -> None:
    """Raise InvalidInputError if there is not one record for each judged trial."""
    if found != trials:
        raise InvalidInputError(str(before), f"it has {found} records, but {trials} trials were judged", CURE)


if __name__ == "__main__":
    raise SystemExit(main())
