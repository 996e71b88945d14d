"""Export job: workers write the episodes, and the complete data set is then moved to its path.

All files are written to a hidden folder next to the target, ``.NAME.parts``. A resumed export reuses the complete
episodes in this folder. A single rename moves the finished data set to its path, so the data set is either complete or
absent. The content of the files depends only on the records and the options.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from betterbench.demonstrations.export.card import card
from betterbench.demonstrations.export.episodes import Dataset, DatasetEpisode
from betterbench.demonstrations.export.layout import DatasetLayout
from betterbench.demonstrations.export.lerobot import json_bytes, write_v30
from betterbench.demonstrations.export.lerobot_v21 import write_v21
from betterbench.demonstrations.export.part import ImageForm, read_index, write_part
from betterbench.demonstrations.export.pictures import Pictures
from betterbench.demonstrations.export.questions import question_set, questions_of
from betterbench.demonstrations.export.robomimic import require_h5py, require_same_content, write_robomimic
from betterbench.demonstrations.export.selection import ChosenTrial, Selection
from betterbench.demonstrations.export.video import VIDEO_SETTINGS, require_even
from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.jobs import OnCount, RunLock, counts, in_threads, run_items, write_durably
from betterbench.jobs.durable import on_disk, remove_parts
from betterbench.jobs.lock import LOCK_NAME
from betterbench.jobs.outputs import require_replaceable
from betterbench.json_form import dump_json, file_digest, open_seal, sealed_form
from betterbench.ordinary_file import read_ordinary
from betterbench.policies.conventions.presets import LEROBOT_SO101, NATIVE
from betterbench.quoting import shell_word
from betterbench.records import Record, RunFolder
from betterbench.records.twins import read_pairs
from betterbench.sim.robots import robot_space
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId, suite_tasks
from betterbench.tasks.user_files import options_by_name
from betterbench.version import __version__

Format = Literal["lerobot", "lerobot-v2.1", "robomimic"]

logger = logging.getLogger(__name__)

EXPORT_VERSION = 1
"""Version of the export, which is increased whenever the same records give different frames."""

SOURCE_FILE = "meta/betterbench.json"
"""Name of the file that describes the origin of a data set."""
README = "README.md"
"""Name of the dataset card, which users may edit."""


@dataclass(frozen=True, slots=True)
class ExportPlan:
    """Description of an export: records, columns, file format and output path.

    Attributes:
        runs: Runs that contain the records.
        selection: Demonstrations to export.
        layout: Columns of the data set.
        to: File format.
        out: Folder of the data set, or its file for robomimic.
        form: Image format, which is always lossless for robomimic.
        quality: Render preset; None for the preset of the runs.
        validation: Fraction of the seeds whose demonstrations are held out for validation.
        language: Whether to write LeRobot's language columns, which LeRobot reads from version 0.6 on.
        questions: Folder of a set of questions about the frames; None to export no questions.
        overwrite: Whether to replace a different data set at the output path, provided that betterbench wrote it. If
            the output is a robomimic file, any file with other content at this path is replaced.
    """

    runs: Sequence[RunFolder]
    selection: Selection
    layout: DatasetLayout
    to: Format
    out: Path
    form: ImageForm = "video"
    quality: str | None = None
    validation: float = 0.0
    language: bool = False
    questions: Path | None = None
    overwrite: bool = False


@dataclass(frozen=True, slots=True)
class Exported:
    """Result of an export.

    Attributes:
        path: Folder or file of the data set.
        episodes: Number of episodes.
        frames: Number of frames.
        bytes: Size of all files [byte].
        made: Number of episodes that were written by this call.
        left_out: Number of trials that were left out, by reason.
        evaluate: Command that evaluates a policy trained on the data set.
    """

    path: Path
    episodes: int
    frames: int
    bytes: int
    made: int
    left_out: Mapping[str, int]
    evaluate: str


def export_dataset(plan: ExportPlan, *, workers: int = 1, on_progress: OnCount | None = None) -> Exported:
    """Export a data set, or finish an interrupted export.

    The content of the files depends only on the plan, not on the number of workers.

    Args:
        plan: Records, columns, file format and output path.
        workers: Number of worker processes.
        on_progress: Called with the number of exported episodes and the total number.

    Raises:
        RunConflictError: If there are other files at the path, or another process is exporting to it.
        RecordError: If a record or a stored scene is missing or damaged.
        InvalidInputError: If the options contradict each other or the records.
        StorageError: If the disk is full.
        MissingDependencyError: If h5py or off-screen OpenGL is missing.
    """
    plan = _checked(plan)
    out, quality = plan.out.absolute(), _quality(plan)
    identity = _identity(plan, quality)
    staging = out.with_name(f".{out.name}.parts")
    if out.is_symlink() and not out.exists():
        raise RunConflictError(f"{out}: this is a broken symbolic link. Remove it, or choose another path.")
    if staging.is_symlink():
        raise RunConflictError(f"{staging}: this is a symbolic link. Remove it.")
    with on_disk(out):
        if out.exists() and not _is_replaced(plan, out, identity):
            told = _finished(plan, out, identity, quality)
            _remove_leftover(staging)
            return told
        with RunLock(staging / LOCK_NAME, output=out):
            remove_parts(staging)
            if out.exists() and not _is_replaced(plan, out, identity):
                told = _finished(plan, out, identity, quality)
                shutil.rmtree(staging, ignore_errors=True)
                return told
            made = _make_parts(plan, staging, quality, workers, on_progress)
            _assemble(plan, staging, out, identity, quality)
            shutil.rmtree(staging, ignore_errors=True)
    return _told(plan, out, made, quality)


def _checked(plan: ExportPlan) -> ExportPlan:
    """Return the plan with the settings that its file format requires. Raises InvalidInputError if options conflict."""
    if plan.to == "robomimic":
        require_h5py()
        plan = replace(plan, form="png")
    if (plan.language or plan.questions) and plan.to != "lerobot":
        raise InvalidInputError(
            "--language", f"{plan.to} does not support language columns", "Export to lerobot, or leave out this option"
        )
    if not 0.0 <= plan.validation < 1.0:
        raise InvalidInputError(
            "--validation", f"{plan.validation:g} is out of range", "Use a fraction of at least 0 and less than 1"
        )
    if plan.form == "video":
        for column in plan.layout.images:
            require_even(column.width, column.height)
    return replace(plan, language=plan.language or plan.questions is not None)


def _quality(plan: ExportPlan) -> str:
    """Return the name of the render preset.

    Raises InvalidInputError if the plan does not name a preset and the runs were rendered with different presets.
    """
    if plan.quality is not None:
        return quality_preset(plan.quality).name
    forms = [run.plan.get("quality", "standard") for run in plan.runs]
    names = sorted({str(form.get("name") if isinstance(form, dict) else form) for form in forms})
    if len(names) > 1:
        raise InvalidInputError(
            "--quality",
            f"the runs were rendered with different presets: {', '.join(names)}",
            "Choose one of them with --quality",
        )
    return quality_preset(names[0]).name


def _identity(plan: ExportPlan, quality: str) -> str:
    """Return a digest of all inputs that determine the bytes of a data set."""
    form = {
        "version": EXPORT_VERSION,
        "to": plan.to,
        "shown": _shown(plan, quality),
        "records": [[str(d.trial), d.digest] for d in plan.selection.demonstrations],
        "left_out": dict(plan.selection.left_out),
        "validation": plan.validation,
        "language": plan.language,
        **({"pairs": pairs} if (pairs := {str(t): ids for (_, t), ids in _pairs(plan).items()}) else {}),
        "questions": question_set(plan.questions).sha256 if plan.questions else None,
    }
    return hashlib.sha256(dump_json(form)).hexdigest()


def _pairs(plan: ExportPlan) -> dict[tuple[int, TrialId], list[str]]:
    return pairs_of(plan.runs, [(d.run, d.trial) for d in plan.selection.demonstrations])


def pairs_of(
    runs: Sequence[RunFolder], demonstrations: Sequence[tuple[int, TrialId]]
) -> dict[tuple[int, TrialId], list[str]]:
    """Return the ids of the pairs of twins that each demonstration belongs to, by run index and trial.

    Twins are demonstrations with the same initial state and different instructions. A pair is only listed if both of
    its demonstrations are exported.
    """
    found: dict[tuple[int, TrialId], list[str]] = {}
    for number, run in enumerate(runs):
        chosen = {trial for of, trial in demonstrations if of == number}
        for pair in read_pairs(run):
            if chosen.issuperset(pair.trials):
                for trial in pair.trials:
                    found.setdefault((number, trial), []).append(pair.pair)
    return found


def _shown(plan: ExportPlan, quality: str) -> dict[str, Any]:
    """Return the settings that affect the exported frames of a given record."""
    video = VIDEO_SETTINGS if plan.form == "video" else {}
    return {"version": EXPORT_VERSION, "layout": plan.layout.to_json(), "quality": quality, "form": plan.form, **video}


def _part_folder(staging: Path, plan: ExportPlan, quality: str, demonstration: ChosenTrial) -> Path:
    told = dump_json({"shown": _shown(plan, quality), "record": demonstration.digest})
    return staging / "parts" / hashlib.sha256(told).hexdigest()[:32]


def _remove_leftover(staging: Path) -> None:
    """Remove the hidden folder of a killed process, unless another process is exporting to the same path."""
    if staging.is_dir():
        with contextlib.suppress(RunConflictError, OSError), RunLock(staging / LOCK_NAME):
            shutil.rmtree(staging, ignore_errors=True)


def _finished(plan: ExportPlan, out: Path, identity: str, quality: str) -> Exported:
    """Return the data set at the output path if it was finished with the same plan.

    Otherwise raise RunConflictError.
    """
    told: Exported | None = None
    there, digests = None, dict[str, str]()
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        source = _stored_source(plan.to, out)
        told = _told(plan, out, 0, quality)
        there, digests = source["identity"], dict(source.get("sha256", {}))
    if told is None or there != identity:
        if there:
            raise RunConflictError(
                f"{out}: another data set already exists here. Pass --overwrite to replace it, or choose another name."
            )
        if out.is_dir():
            raise RunConflictError(
                f"{out}: a folder that `better export` did not write already exists here, and is not replaced. Choose "
                "another name."
            )
        require_replaceable(out, "export", is_ours=lambda _: False)
        raise RunConflictError(f"{out}: an empty file already exists here. Remove it, or choose another name.")
    again = "Rename or delete the data set, and run the command again"
    if plan.to == "robomimic":
        require_same_content(out, cure=again)
    elif not digests:
        logger.warning(
            "%s: an earlier version wrote this data set without digests of its files, so changes cannot be detected",
            out,
        )
    lost = next((name for name, digest in digests.items() if _digest(out / name) != digest), None)
    if lost is not None:
        raise RunConflictError(f"{out / lost}: the file is missing or has changed since it was written. {again}.")
    return told


def _digest(file: Path) -> str | None:
    """Return the SHA-256 of a file. Return None if the file does not exist."""
    return file_digest(file) if file.is_file() else None


def _is_replaced(plan: ExportPlan, out: Path, identity: str) -> bool:
    """Return whether the export replaces the content of the output path.

    This requires ``overwrite``. If the path is a folder, it must also contain a data set that betterbench wrote.
    """
    if not plan.overwrite or out.is_symlink():
        return False
    there = None
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        there = _stored_source(plan.to, out)["identity"]
    return there != identity and (isinstance(there, str) or (plan.to == "robomimic" and out.is_file()))


def _stored_source(to: Format, out: Path) -> dict[str, Any]:
    """Read the description of a data set's origin from its files."""
    if to == "robomimic":
        from betterbench.demonstrations.export.robomimic import read_origin  # noqa: PLC0415 - needs the extra

        return read_origin(out)
    return stored_source(out)


def stored_source(folder: Path) -> dict[str, Any]:
    """Read the description of a data set's origin from its folder.

    Raises:
        RunConflictError: If the file that describes the origin was changed.
        OSError: If the file is missing.
    """
    file = folder / SOURCE_FILE
    cure = "Rename or delete the data set, and export it again"
    return open_seal(read_ordinary(file), where=str(file), cure=cure, raises=RunConflictError, since=("version", 2))


def _make_parts(plan: ExportPlan, staging: Path, quality: str, workers: int, on_progress: OnCount | None) -> int:
    """Write the episodes that are missing in the hidden folder, and return the number of written episodes."""
    wanted = {_part_folder(staging, plan, quality, d): d for d in plan.selection.demonstrations}

    def make(pictures: Pictures, folder: Path) -> None:
        demonstration = wanted[folder]
        run = plan.runs[demonstration.run]
        record = _record(run, demonstration)
        _check_rate(record)
        write_part(folder, record, plan.layout, pictures.of(run, record), plan.form)

    def work(missing: Iterable[Path]) -> Iterator[None]:
        # Trials with the same scene are rendered in succession, because opening a scene takes longer than rendering an
        # image.
        order = sorted(missing, key=lambda f: (wanted[f].scene_hash, wanted[f].trial, wanted[f].run))
        cameras = plan.layout.cameras
        return in_threads(order, make, workers=workers, open_resource=lambda: Pictures(cameras, quality))

    return run_items(
        wanted, is_done=lambda part: read_index(part) is not None, work=work, on_progress=counts(on_progress)
    )


def _record(run: RunFolder, demonstration: ChosenTrial) -> Record:
    trial = demonstration.trial
    return run.read_record(trial.task, trial.condition, trial.seed, digest=demonstration.digest)


def _check_rate(record: Record) -> None:
    rate = record.metadata.control_rate_hz
    if abs(rate - round(rate)) > 1e-9:
        raise InvalidInputError("control rate", f"{rate:g} Hz is not an integer", "Record at 20 Hz instead")
    if record.n_steps < 2:
        m = record.metadata
        raise RecordError(
            f"{m.task}/{m.condition}/{m.seed}: the record has {record.n_steps} steps, which is too few for an episode."
        )


def _assemble(plan: ExportPlan, staging: Path, out: Path, identity: str, quality: str) -> None:
    """Write the data set into the hidden folder, and move it to its path."""
    dataset = _dataset(plan, staging, identity, quality)
    whole = staging / "dataset"
    shutil.rmtree(whole, ignore_errors=True)
    whole.mkdir(parents=True)
    replaced = staging / "replaced"
    if plan.to == "robomimic":
        write_robomimic(whole / out.name, dataset)
        (whole / out.name).replace(out)
        return
    stats = (write_v30 if plan.to == "lerobot" else write_v21)(whole, dataset)
    write_durably(whole / README, card(dataset, stats).encode())
    written = {str(p.relative_to(whole)): p for p in sorted(whole.rglob("*")) if p.is_file()}
    files = {name: p.stat().st_size for name, p in written.items()}
    digests = {name: file_digest(p) for name, p in written.items()}
    write_durably(
        whole / SOURCE_FILE,
        json_bytes(sealed_form({**dataset.source, "version": 2, "files": files, "sha256": digests})),
    )
    # The replaced data set is deleted together with the hidden folder.
    if out.exists():
        shutil.rmtree(replaced, ignore_errors=True)
        out.rename(replaced)
    whole.replace(out)


def _dataset(plan: ExportPlan, staging: Path, identity: str, quality: str) -> Dataset:
    """Collect the exported episodes into a data set. The training episodes come first."""
    shown = plan.selection.demonstrations
    asked = questions_of(question_set(plan.questions), plan.layout, shown) if plan.questions else {}
    pairs = _pairs(plan)
    episodes, rates = [], set()
    for d in plan.selection.demonstrations:
        folder = _part_folder(staging, plan, quality, d)
        index = read_index(folder)
        if index is None:
            raise RecordError(f"{folder}: this episode is damaged or incomplete. Run the export again.")
        rates.add(round(index.about["control_rate_hz"]))
        about = {**index.about, "pairs": pairs.get((d.run, d.trial), [])} if pairs else index.about
        episodes.append(DatasetEpisode(folder, about, d.digest, asked.get(d.digest, ())))
    if len(rates) > 1:
        raise InvalidInputError(
            "control rate", f"it differs between runs: {sorted(rates)} Hz", "Export these runs one by one"
        )
    held_out = validation_seeds({d.trial.seed for d in plan.selection.demonstrations}, plan.validation)
    train = [e for e in episodes if e.about["seed"] not in held_out]
    ordered = tuple(train + [e for e in episodes if e.about["seed"] in held_out])
    source = origin_of(
        ordered, plan.layout, plan.form, quality, identity=identity, left_out=dict(plan.selection.left_out)
    )
    return Dataset(ordered, plan.layout, plan.form, rates.pop(), len(train), plan.language, source)


def validation_seeds(seeds: set[int], share: float) -> set[int]:
    """Choose the seeds that are held out for validation, so that at least one seed remains for training.

    Conditions with the same seed have the same object layout. Therefore all demonstrations with a held-out seed are
    held out.
    """
    by_hash = sorted(seeds, key=lambda seed: hashlib.sha256(f"validation {seed}".encode()).digest())
    return set(by_hash[: min(round(share * len(seeds)), len(seeds) - 1)])


def origin_of(
    episodes: Sequence[DatasetEpisode],
    layout: DatasetLayout,
    form: ImageForm,
    quality: str,
    *,
    identity: object,
    left_out: object,
) -> dict[str, Any]:
    """Return the description of a data set's origin, without the file sizes, which are added later."""
    return {
        "export_version": EXPORT_VERSION,
        "identity": identity,
        "package_version": __version__,
        "suite_version": ", ".join(sorted({str(e.about["suite_version"]) for e in episodes})),
        "policies": sorted({str(e.about["policy"]) for e in episodes}),
        "looks": sorted({str(e.about["looks"]) for e in episodes}),
        "quality": quality,
        "images": form,
        "video": VIDEO_SETTINGS if form == "video" else None,
        "evaluate": evaluation_command(layout, quality, {str(e.about["task"]) for e in episodes}),
        "left_out": left_out,
        "layout": layout.to_json(),
        "episodes": [{**e.about, "record": e.record} for e in episodes],
    }


def is_split(trials: Sequence[TrialId], train: int) -> bool:
    """Return whether an export could have used the first ``train`` trials for training and the others for validation.

    All trials with a held-out seed are held out, and held-out trials come last. The fraction of held-out seeds is not
    stored in the data set. The function therefore returns True if any fraction leads to this split.
    """
    held_out, seeds = {trial.seed for trial in trials[train:]}, {trial.seed for trial in trials}
    first = sorted(trial for trial in trials if trial.seed not in held_out)
    last = sorted(trial for trial in trials if trial.seed in held_out)
    chosen = validation_seeds(seeds, len(held_out) / len(seeds)) if seeds else None
    return len(first) == train > 0 and held_out == chosen and list(trials) == first + last


def evaluation_command(layout: DatasetLayout, quality: str, tasks: Collection[str]) -> str:
    """Return the command that evaluates a policy trained on the data set. The policy address in it is a placeholder.

    If the data set demonstrates all tasks of the suite, the command evaluates the complete suite. If it demonstrates
    only some tasks, the command evaluates a few trials of these tasks.
    """
    name = layout.adapter.name
    words = ["better eval --policy"]
    own = {"lerobot": "lerobot:CHECKPOINT", NATIVE.name: "python:FILE.py:CLASS"}
    own |= {motors: f'"lerobot:CHECKPOINT?preset={motors}"' for motors in LEROBOT_SO101}
    words.append(own.get(name, f'"PROTOCOL://HOST:PORT?preset={name}"'))
    if layout.observation.name != "default":
        words.append(f"--observation {layout.observation.name}")
    if layout.robot != USUAL_ROBOT:
        words.append(f"--robot {layout.robot}")
    if layout.adapter.answer.space != robot_space(layout.robot):
        words.append(f"--action-space {layout.adapter.answer.space}")
    if quality != "standard":
        words.append(f"--quality {quality}")
    if set(suite_tasks("better60")) <= set(tasks):
        words.append("--suite better60")
    else:
        words.append(f"--tasks {' '.join(map(shell_word, sorted(set(tasks))))} --trials 3")
    # Task files are given by name, because other users of the data set keep them in other folders.
    words += map(shell_word, options_by_name(tasks))
    return " ".join([*words, "--out RUN"])


def _told(plan: ExportPlan, out: Path, made: int, quality: str) -> Exported:
    source = _stored_source(plan.to, out)
    files = [out] if out.is_file() else [path for path in out.rglob("*") if path.is_file()]
    return Exported(
        out,
        len(source["episodes"]),
        sum(int(about["rows"]) for about in source["episodes"]),
        sum(path.stat().st_size for path in files),
        made,
        plan.selection.left_out,
        evaluation_command(plan.layout, quality, {str(about["task"]) for about in source["episodes"]}),
    )
