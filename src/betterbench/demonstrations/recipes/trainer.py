"""Setup for training with a recipe: files and sourced settings for the framework, and manual checks."""

from __future__ import annotations

import importlib.resources
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from string import Template
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

from betterbench.demonstrations.export.card import STILL
from betterbench.demonstrations.recipes.recipe import Recipe, Setting
from betterbench.errors import UNPRINTABLE, InvalidInputError, one_line, require_between
from betterbench.interface.actions import CONTROL_RATE_HZ, SO101_DEGREES
from betterbench.json_form import open_form, open_seal, read_bounded, read_form
from betterbench.quoting import ShellText, shell_line, shell_word
from betterbench.tasks import get_task

SOURCE_FILE = Path("meta/betterbench.json")
_CURE = "Use a folder that `better export` wrote, or a folder that does not exist yet"
_RECORD_AGAIN = "Use a data set that `lerobot-record` wrote, with so101_follower and the cameras 'front' and 'wrist'"
_MAX_META_BYTES = 1 << 28
REAL_CAMERAS = ("front", "wrist")
SO101_COLUMNS = SO101_DEGREES.components
"""Names of the components of state and action, as in LeRobot's so101_follower."""
REAL_PRESET = "lerobot_so101_degrees"
"""Adapter preset for evaluating a policy that was trained on data of a real SO-101."""
REAL_RATE_HZ = CONTROL_RATE_HZ
"""Rate of demonstrations and trials in the real-arm protocol [Hz]. It equals the control rate of the simulated arm."""
DEMONSTRATIONS = 25
"""Number of demonstrations per training condition in the paper."""


@dataclass(frozen=True, slots=True)
class TrainingData:
    """Data set used for training.

    Attributes:
        place: Folder of the data set, or its name on the Hugging Face hub.
        preset: Export preset of the data set if betterbench exported it; "" for other data.
        frames: Number of frames; None if the data set is not on this machine.
        quality: Render quality of the images.
        still: Components that are nearly constant, so that normalization amplifies their noise.
        rate_hz: Frame rate [Hz]; None if the data set is not on this machine.
        episodes: Number of episodes; None if the data set is not on this machine.
    """

    place: str
    preset: str
    frames: int | None = None
    quality: str = "standard"
    still: tuple[str, ...] = ()
    rate_hz: float | None = None
    episodes: int | None = None

    @property
    def name(self) -> str:
        """Last part of the data set's path."""
        return Path(self.place).name


@dataclass(frozen=True, slots=True)
class Training:
    """Training run requested by the user.

    Attributes:
        recipe: Recipe to follow.
        data: Data sets. Several data sets require a framework that can mix them.
        gpus: Number of GPUs.
        weights: Initial weights; None for the weights that the framework publishes.
        policy: Policy type, for LeRobot.
        sample_tokens: Number of tokens in one sample, for the sequence packing of Being-H.
    """

    recipe: Recipe
    data: tuple[TrainingData, ...]
    gpus: int = 4
    weights: str | None = None
    policy: str = "pi05"
    sample_tokens: int = 220

    def __post_init__(self) -> None:
        """Raise InvalidInputError if a number is out of range or the path of the weights is invalid."""
        require_between("--gpus", self.gpus, 1, 4096)
        require_between("--sample-tokens", self.sample_tokens, 1, 100_000)
        if self.weights is not None and not _is_place(self.weights):
            raise InvalidInputError("--weights", f"{self.weights!r} is not a path", "Pass a file or a folder")

    @property
    def only_data(self) -> TrainingData:
        """The only data set, for frameworks that cannot mix data sets.

        Raises InvalidInputError if there are several.
        """
        if len(self.data) != 1:
            raise InvalidInputError(
                "--data",
                f"{len(self.data)} data sets are given, but this trainer reads only one",
                "Merge them into one data set before training",
            )
        return self.data[0]

    @property
    def batch_of_gpu(self) -> int:
        """Batch size per GPU.

        Raises InvalidInputError if the total batch size is not divisible by the number of GPUs.
        """
        batch = self.recipe.batch
        if batch % self.gpus:
            divisors = ", ".join(str(n) for n in range(1, batch + 1) if batch % n == 0)
            raise InvalidInputError(
                "--gpus",
                f"a batch of {batch} cannot be divided evenly among {self.gpus} GPUs",
                f"Use one of these numbers of GPUs: {divisors}",
            )
        return batch // self.gpus


_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
"""Pattern for names of data sets that every trainer accepts in paths, commands and YAML files."""


@dataclass(frozen=True, slots=True)
class TrainerSetup:
    """Setup for training with a framework: files, configuration fields, commands and manual checks.

    Attributes:
        framework: Name of the framework.
        upstream: Repository and commit (or release) that the fields were taken from.
        files: Content of each file, by file name.
        settings: Fields of the framework's configuration.
        commands: Title and command lines of each step, in order.
        evaluation: Commands that evaluate the trained policy.
        checks: Manual checks for errors that the framework does not report.
    """

    framework: str
    upstream: str
    files: dict[str, str]
    settings: tuple[Setting, ...]
    commands: tuple[tuple[str, str], ...]
    evaluation: str
    checks: tuple[str, ...] = field(default_factory=tuple)


def data_of(place: str, *, preset: str, version: str, benchmark: str) -> TrainingData:
    """Describe a data set. Values that are read from its files are None if the files are not on this machine.

    Args:
        place: Folder of the data set. For other benchmarks, it may also be the name of a data set on the hub.
        preset: Export preset that the trainer needs, for data exported by betterbench.
        version: Version of LeRobot's format that the trainer reads ("v2.1" or "v3.0").
        benchmark: Benchmark of the recipe.

    Raises:
        InvalidInputError: If the data set is on this machine but does not fit the trainer.
    """
    folder = Path(place)
    if not _is_place(place):
        raise InvalidInputError("--data", f"{place!r} is not the path of a data set", "Pass the folder of a data set")
    if not _NAME.fullmatch(folder.name):
        problem = f"{folder.name!r}, the last part of {place!r}, is not a valid name of a data set"
        raise InvalidInputError("--data", problem, "Rename the folder, using only letters, digits, '_', '.' and '-'")
    if benchmark == "real" and folder.exists():
        return recorded_data(folder)
    if benchmark != "better" or not folder.exists():
        return TrainingData(place, preset if benchmark == "better" else "")
    file = folder / SOURCE_FILE
    raw = read_bounded(file, max_bytes=_MAX_META_BYTES, cure=_CURE)
    source = read_form(
        _SOURCE, open_seal(raw, where=str(file), cure=_CURE, since=("version", 2)), where=str(file), cure=_CURE
    )
    to = "lerobot" if version == "v3.0" else "lerobot-v2.1"
    cure = f"Export it with `better export RUN --to {to} --preset {preset} --out {shell_word(place)}`"
    if source.layout.adapter.name != preset:
        found = one_line(source.layout.adapter.name, most=80)
        raise InvalidInputError(place, f"its layout is {found}, but this trainer needs {preset}", cure)
    info = _read(folder / "meta/info.json", _INFO)
    if info.codebase_version != version:
        found = one_line(info.codebase_version, most=80)
        raise InvalidInputError(place, f"its format is LeRobot {found}, expected {version}", cure)
    stats = _read(folder / "meta/stats.json", _STATS)
    try:
        still = tuple(
            f"{column}[{i}]"
            for column in source.layout.vectors
            for i, (low, high) in enumerate(zip(*_quantiles(stats[column]), strict=True))
            if high - low < STILL
        )
    except (KeyError, ValueError, ValidationError) as error:
        problem = f"its meta files are inconsistent ({one_line(repr(error), most=200)})"
        raise InvalidInputError(place, problem, cure) from error
    return TrainingData(place, preset, info.total_frames, source.quality, still)


def recorded_data(folder: Path) -> TrainingData:
    """Describe a data set that LeRobot recorded with an SO-101.

    Raises:
        InvalidInputError: If the format version, the arm or the cameras differ from the protocol.
    """
    info = _read(folder / "meta/info.json", _RECORDED, cure=_RECORD_AGAIN)
    place = str(folder)
    if info.codebase_version != "v3.0":
        found = one_line(info.codebase_version, most=80)
        raise InvalidInputError(
            place, f"its format is LeRobot {found}, expected v3.0", "Convert the data with LeRobot's conversion script"
        )
    for column in ("observation.state", "action"):
        names = info.features[column].names if column in info.features else None
        if names is None or tuple(names) != SO101_COLUMNS:
            problem = f"{column} does not have the six positions of an SO-101 ({SO101_COLUMNS[0]} ... gripper.pos)"
            raise InvalidInputError(place, problem, _RECORD_AGAIN)
    missing = [name for name in REAL_CAMERAS if f"observation.images.{name}" not in info.features]
    if missing:
        cameras = ", ".join(sorted(c.removeprefix("observation.images.") for c in info.features if ".images." in c))
        problem = f"expected a camera {missing[0]!r}, found {cameras or 'none'}"
        raise InvalidInputError(place, problem, "Name the cameras 'front' and 'wrist' when recording")
    return TrainingData(place, "", info.total_frames, rate_hz=info.fps, episodes=info.total_episodes)


def _quantiles(of: Mapping[str, Any]) -> tuple[list[float], list[float]]:
    return _NUMBERS.validate_python(of["q01"]), _NUMBERS.validate_python(of["q99"])


@open_form
@dataclass(frozen=True, slots=True)
class _Adapter:
    name: str


@open_form
@dataclass(frozen=True, slots=True)
class _Layout:
    adapter: _Adapter
    vectors: Mapping[Annotated[str, Field(max_length=200)], Any]


@open_form
@dataclass(frozen=True, slots=True)
class _Source:
    """Fields of :data:`SOURCE_FILE` that this module uses."""

    layout: _Layout
    quality: Literal["fast", "standard", "high"]


@open_form
@dataclass(frozen=True, slots=True)
class _Info:
    """Fields of ``meta/info.json`` that this module uses."""

    codebase_version: str
    total_frames: Annotated[int, Field(ge=1, le=10**12)]


@open_form
@dataclass(frozen=True, slots=True)
class _Feature:
    """Names of a feature's components. For an image, these are the names of its axes."""

    names: tuple[str, ...] | dict[str, Any] | None = None


@open_form
@dataclass(frozen=True, slots=True)
class _Recorded:
    """Fields of ``meta/info.json`` that this module uses for a data set recorded with a real arm."""

    codebase_version: str
    total_frames: Annotated[int, Field(ge=1, le=10**12)]
    total_episodes: Annotated[int, Field(ge=1, le=10**9)]
    fps: Annotated[float, Field(gt=0.0, le=1000.0)]
    features: dict[str, _Feature]


_RECORDED = TypeAdapter(_Recorded)
_SOURCE, _INFO = TypeAdapter(_Source), TypeAdapter(_Info)
_STATS, _NUMBERS = TypeAdapter(dict[str, dict[str, Any]]), TypeAdapter(list[float])
_Form = TypeVar("_Form")


def _read(path: Path, form: TypeAdapter[_Form], *, cure: str = _CURE) -> _Form:
    return read_form(form, read_bounded(path, max_bytes=_MAX_META_BYTES, cure=cure), where=str(path), cure=cure)


def _is_place(text: str) -> bool:
    return bool(text) and not any(letter in "\t\n" or UNPRINTABLE.match(letter) for letter in text)


def export_line(data: TrainingData, to: str, *, images: str = "video", place: str | None = None) -> str:
    """Return the ``better export`` command that writes a data set.

    Args:
        data: The data set.
        to: Format of the data set.
        images: How images are stored, "video" or "png".
        place: Output folder; None for the folder of ``data``.
    """
    words = ["better", "export", "runs/demos", "--to", to, "--preset", data.preset]
    words += ["--images", images] * (images != "video") + ["--out", place or data.place]
    return shell_line(words)


def record_lines(place: str) -> str:
    """Return the commands that record the demonstrations of the BeTTER paper.

    There is one recording session per instruction and object layout.
    """
    task = get_task("fruit_basket")
    lines = []
    for number, condition in enumerate(task.training):
        words = ["lerobot-record", "--robot.type=so101_follower", "--robot.port=/dev/ttyACM0", "--robot.id=follower"]
        cameras = ", ".join(
            f"{name}: {{type: opencv, index_or_path: {index}, width: 640, height: 480, fps: 30}}"
            for name, index in zip(REAL_CAMERAS, (0, 2), strict=True)
        )
        words += ["--robot.use_degrees=true", f"--robot.cameras={{ {cameras} }}", "--teleop.type=so101_leader"]
        words += [
            "--teleop.port=/dev/ttyACM1",
            "--teleop.id=leader",
            "--teleop.use_degrees=true",
            f"--dataset.repo_id=local/{Path(place).name}",
            f"--dataset.root={place}",
        ]
        words += [f"--dataset.fps={REAL_RATE_HZ:g}", f"--dataset.num_episodes={DEMONSTRATIONS}"]
        words += [f"--dataset.single_task={condition.instruction.text}", "--dataset.push_to_hub=false"]
        words += ["--resume=true"] * bool(number)
        lines += [f"# train{number + 1}, {condition.cloth} tablecloth:", shell_line(words)]
    return "\n".join(lines)


def real_evaluation(name: str, address: str, data: TrainingData) -> str:
    """Return the commands that evaluate a policy on the real arm, and on the same arm in simulation.

    Args:
        name: Name of the policy in the evaluation.
        address: Policy address, such as ``openpi://localhost:8000``.
        data: Data set on which the policy was trained.
    """
    rate = data.rate_hz or REAL_RATE_HZ
    plan = ["better", "real", "plan", "--out", "bench", "--policies", f"{name}={address}", "--trials", "3"]
    plan += ["--rate-hz", f"{rate:g}"] * (rate != REAL_RATE_HZ)
    run = ["better", "real", "run", "bench", "--arm-port", "/dev/ttyACM0", "--cameras", "front=0", "wrist=2"]
    twin = ["better", "eval", "--policy", address, "--suite", "real_world", "--action-space", "so101_degrees"]
    return "\n".join(
        (
            shell_line(plan),
            shell_line(run),
            shell_line(["better", "real", "judge", "bench", "--person", "NAME"]),
            "# the same policy on the simulated twin, and a report that compares both:",
            shell_line([*twin, "--trials", "3", "--out", f"runs/{name}_twin"]),
            shell_line(["better", "real", "report", "bench", "--sim", f"runs/{name}_twin"]),
        )
    )


def real_checks(data: TrainingData) -> tuple[str, ...]:
    """Return the manual checks for training on data recorded with a real arm."""
    wanted = DEMONSTRATIONS * len(get_task("fruit_basket").training)
    found = [
        f"The paper uses {DEMONSTRATIONS} demonstrations of each of four training conditions, {wanted} in total"
        + ("." if data.episodes is None else f"; this data set has {data.episodes}."),
        "Arm and cameras are mounted as described in docs/real-setup.md, in demonstrations and in trials.",
    ]
    if data.rate_hz is not None and data.rate_hz != REAL_RATE_HZ:
        found.append(
            f"The data are recorded at {data.rate_hz:g} Hz, but the simulated twin runs at {REAL_RATE_HZ:g} Hz. The "
            f"policy therefore moves more slowly on the twin."
        )
    return tuple(found)


def evaluation_lines(
    recipe: Recipe, data: TrainingData, *, address: str, on_libero: str, libero_address: str | None = None
) -> str:
    """Return the commands that evaluate the trained policy.

    Policies trained on betterbench's own demonstrations are evaluated on its suite. Policies trained for LIBERO are
    evaluated with LIBERO's own code and, if possible, also on betterbench's suite.

    Args:
        recipe: Training recipe.
        data: Data set on which the policy is trained.
        address: Policy address, such as ``openpi://localhost:8000``, for a policy trained on betterbench's
            demonstrations.
        on_libero: Commands of the framework's own LIBERO evaluation, for a policy trained for LIBERO.
        libero_address: Policy address for evaluating a policy trained for LIBERO on betterbench's suite; None if this
            is not possible.
    """
    if recipe.benchmark == "better":
        return _evaluation_line(address, recipe, data)
    if recipe.benchmark == "libero":
        unseen = "" if libero_address is None else _evaluation_line(libero_address, recipe, data)
        return on_libero + (f"\n# on betterbench's suite, without training on it:\n{unseen}" if unseen else "")
    return (
        "# CALVIN's own evaluation (calvin_models/calvin_agent/evaluation); betterbench has no preset for its actions"
    )


def _evaluation_line(address: str, recipe: Recipe, data: TrainingData) -> str:
    words = ["better", "eval", "--policy", address, "--suite", "better60"]
    words += ["--quality", data.quality] * (data.quality != "standard")
    return shell_line([*words, "--out", f"runs/{recipe.name}"])


def own_file(file: str) -> ShellText:
    """Return the path of a file in the recipe folder, quoted for the shell scripts in that folder."""
    return ShellText(f'"$HERE/{file}"')


def flag_lines(command: str, flags: Sequence[tuple[str, str]]) -> str:
    """Format a shell command with one flag per line."""
    return " \\\n  ".join([command, *(f"{name} {value}".rstrip() for name, value in flags)])


def filled(name: str, texts: Mapping[str, str] | None = None) -> str:
    """Fill in the placeholders of one of this package's templates.

    Args:
        name: File name of the template.
        texts: Text for each placeholder.
    """
    file = importlib.resources.files("betterbench.demonstrations.recipes") / "data" / name
    return Template(file.read_text(encoding="utf-8")).substitute(texts or {})


def exposure(training: Training) -> str:
    """Describe the number of samples used for training and, if the data set is known, the number of epochs."""
    frames = [data.frames for data in training.data]
    known = [n for n in frames if n is not None]
    samples = training.recipe.steps * training.recipe.batch
    told = f"{training.recipe.steps:,} steps with a batch size of {training.recipe.batch} use {samples:,} samples"
    if not known or len(known) < len(frames):
        return told + "."
    return f"{told}: {samples / sum(known):.1f} passes over the {sum(known):,} frames of the data."
