"""Training recipes: all settings that determine a learner's weights."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface import observation_spec
from betterbench.json_form import read_form, strict_form
from betterbench.policies.learned.families import Capacity, Option, Sees, learner_family

RECIPE_VERSION: Literal[1] = 1
"""Version of the training procedure."""

CURE = "Correct the recipe. docs/training.md shows an example"

_Loss = Literal["l1", "flow"]

_Positive = Annotated[int, Field(ge=1, le=10_000_000)]
_Share = Annotated[float, Field(ge=0.0, lt=1.0)]
_Length = Annotated[float, Field(ge=0.0, le=0.1)]
_Edge = Annotated[float, Field(ge=0.0, le=1.0)]
_LEAST_WINDOW = 0.02


_WHOLE = (0.0, 0.0, 1.0, 1.0)


@strict_form
@dataclass(frozen=True, slots=True)
class Proprioception:
    """Proprioceptive inputs of a learner.

    Attributes:
        given: Whether the learner gets the tool pose, the fingers, and inputs derived from them.
        noise_m: Standard deviation of noise on the tool's position in training [m].
        dropout: Fraction of training samples without any proprioception.
    """

    given: bool = True
    noise_m: _Length = 0.0
    dropout: _Share = 0.0


@strict_form
@dataclass(frozen=True, slots=True)
class Augmentation:
    """Random augmentation of training samples.

    The first two settings apply to ``objects``, the last two to ``pixels``.

    Attributes:
        object_noise_m: Standard deviation of noise on each object's position [m].
        shift_m: Half the side length of the square in which tool and all objects are shifted together [m].
        shift_px: Largest shift of an image along each axis [pixel], with edge padding, as by padding and a random crop.
        light: Standard deviation of changes in image contrast and brightness, as a fraction of the full range.
    """

    object_noise_m: _Length = 0.0
    shift_m: _Length = 0.0
    shift_px: Annotated[int, Field(ge=0, le=64)] = 4
    light: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0


@strict_form
@dataclass(frozen=True, slots=True)
class View:
    """Image input of a learner in the ``pixels`` family: a camera image or part of it.

    Attributes:
        camera: Camera name.
        window: Left, top, right and bottom edge of the crop, as fractions of the camera image. A window of ``size``
            pixels is copied one to one, and the complete image is scaled.
    """

    camera: str
    window: tuple[_Edge, _Edge, _Edge, _Edge] = _WHOLE

    def __post_init__(self) -> None:
        """Reject an empty window."""
        left, top, right, bottom = self.window
        if right - left < _LEAST_WINDOW or bottom - top < _LEAST_WINDOW:
            problem = f"{list(self.window)} is empty or too small"
            raise InvalidInputError("window", problem, "Give left, top, right, bottom from 0 to 1")


@strict_form
@dataclass(frozen=True, slots=True)
class Eyes:
    """Image inputs for a learner of the ``pixels`` family.

    Attributes:
        observation: Observation preset with the cameras of the images. Evaluation must use the same preset.
        views: The images, given as names of cameras or as cameras with windows.
        size: Side of each image for the network [pixel].
        quality: Render preset of the training images.
    """

    observation: str = "default"
    views: Annotated[tuple[str | View, ...], Field(min_length=1, max_length=8)] = ("front", "wrist")
    size: Annotated[int, Field(ge=16, le=256, multiple_of=8)] = 96
    quality: Literal["fast", "standard", "high"] = "standard"

    def __post_init__(self) -> None:
        """Reject a camera that the observation does not contain."""
        try:
            observation_spec(self.observation).only(self.cameras)
        except UnknownNameError as error:
            raise InvalidInputError("eyes", str(error).rstrip("."), "Give cameras of an observation preset") from error

    @property
    def windows(self) -> tuple[View, ...]:
        """The images as cameras with windows."""
        return tuple(View(view) if isinstance(view, str) else view for view in self.views)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras to render, each once."""
        return tuple(dict.fromkeys(view.camera for view in self.windows))


@strict_form
@dataclass(frozen=True, slots=True)
class CoTraining:
    """Questions that the network learns in addition to actions.

    Attributes:
        sets: Folders of ``better vqa`` about the training demonstrations.
        weight: Number of questions per frame with actions. The paper samples actions with weight 8.0 and each of four
            sets of texts with weight 0.5 (appendix A.2), which gives 0.25.
    """

    sets: Annotated[tuple[str, ...], Field(min_length=1)]
    weight: Annotated[float, Field(gt=0.0, le=10.0)] = 0.25


@strict_form
@dataclass(frozen=True, slots=True)
class TrainingRecipe:
    """Recipe for training a learner, with its data, network, optimization and validation.

    Attributes:
        data: Folders written by ``better dataset``, or runs of ``better collect``, ``amplify`` or ``teleop``.
        family: ``objects`` for poses, sizes, categories and colors as from a perfect detector, ``pixels`` for images,
            or the name of a user's family.
        options: Options of a user's family.
        tasks: Tasks whose demonstrations are used. If empty, all tasks in the data are used.
        variations: Whether to include demonstrations of test variations, as in the covered training distribution.
        demonstrations: Maximum number of demonstrations per condition, lowest seeds first, or None for all.
        longest_pause: Maximum number of control steps that are used from a pause of the demonstrator, or None for all.
        every: Stride between input frames in training. The actions of a chunk are consecutive.
        eyes: Image inputs for a ``pixels`` learner.
        capacity: ``small``, ``base`` or ``large``, or width, layers and heads.
        history: Number of tool states in the input, which are the present state and earlier states.
        history_stride: Control steps between these states. For ``pixels``, whose learners answer every ``execute``
            steps, it must be a multiple of ``execute``.
        chunk: Number of actions in one answer.
        execute: Execution horizon, which is the number of actions executed from an answer before the next answer.
        loss: ``l1``, or ``flow`` for flow matching.
        flow_steps: Number of integration steps when an action chunk is sampled from a flow.
        dropout: Share of activations dropped in training.
        gripper_weight: Sampling weight for a sample at a gripper change. Other samples have weight 1.
        co_training: Questions learned in addition to actions, or None.
        start: Checkpoint with the initial weights, or None.
        frozen: Parts whose weights are not trained.
        learning_rate: Largest rate of AdamW, reached after ``warmup`` steps. It then falls to zero along a cosine.
        ema: Decay of the moving average of the weights. This average is used for evaluation.
        clip: Largest norm of the gradient.
        validation: Share of seeds that are held out, chosen as by ``better export --validation``.
        validate_every: Steps between two validations.
        rollouts: Number of rollouts in each validation, from the initial states of held-out demonstrations.
        save_every: Number of steps between two saved states, from which training resumes.
        threads: Threads of one process. Weights are reproducible only with the same number of threads.
    """

    data: Annotated[tuple[str, ...], Field(min_length=1)]
    family: str = "objects"
    options: Mapping[str, Option] = field(default_factory=dict)
    tasks: tuple[str, ...] = ()
    variations: bool = False
    demonstrations: _Positive | None = None
    longest_pause: Annotated[int, Field(ge=0, le=1000)] | None = 1
    every: Annotated[int, Field(ge=1, le=100)] = 1
    eyes: Eyes = field(default_factory=Eyes)
    capacity: Literal["small", "base", "large"] | Capacity = "base"
    proprioception: Proprioception = field(default_factory=Proprioception)
    augmentation: Augmentation = field(default_factory=Augmentation)
    history: Annotated[int, Field(ge=1, le=16)] = 1
    history_stride: Annotated[int, Field(ge=1, le=100)] = 4
    chunk: Annotated[int, Field(ge=1, le=100)] = 8
    execute: Annotated[int, Field(ge=1, le=100)] = 4
    loss: _Loss = "l1"
    flow_steps: Annotated[int, Field(ge=1, le=100)] = 10
    dropout: _Share = 0.0
    gripper_weight: Annotated[float, Field(ge=1.0, le=100.0)] = 3.0
    co_training: CoTraining | None = None
    start: str | None = None
    frozen: tuple[str, ...] = ()
    steps: _Positive = 12_000
    batch: Annotated[int, Field(ge=1, le=65_536)] = 128
    learning_rate: Annotated[float, Field(gt=0.0, le=1.0)] = 1e-3
    warmup: Annotated[int, Field(ge=0)] = 100
    weight_decay: Annotated[float, Field(ge=0.0, le=1.0)] = 1e-4
    ema: _Share = 0.999
    clip: Annotated[float, Field(gt=0.0)] = 1.0
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    validation: Annotated[float, Field(ge=0.0, le=0.5)] = 0.1
    validate_every: _Positive = 2_000
    rollouts: Annotated[int, Field(ge=0, le=1000)] = 4
    save_every: _Positive = 250
    threads: Annotated[int, Field(ge=1, le=256)] = 1
    version: Literal[1] = RECIPE_VERSION

    def __post_init__(self) -> None:
        """Reject settings that contradict each other or that the family does not support."""
        self._require_family()
        if self.execute > self.chunk:
            problem = f"{self.execute} exceeds the {self.chunk} actions of a chunk"
            raise InvalidInputError("execute", problem, "Give at most that number")
        if self.start is None and self.frozen:
            raise InvalidInputError("frozen", "frozen parts would keep random weights", "Give a checkpoint as start")
        foreign = next((f"{name}" for name, theirs in self._of_other_families() if theirs), None)
        if foreign is not None:
            problem = f"the family {self.family} does not have this field"
            raise InvalidInputError(foreign, problem, "Leave out this field, or change the family")
        parts = set(learner_family(self.family).parts) - (set() if self.proprioception.given else {"state"})
        if parts <= set(self.frozen) and self.built_in:
            raise InvalidInputError("frozen", "all parts are frozen", "Freeze fewer parts")
        if self.co_training is not None and self.questions == 0:
            problem = (
                f"a share of {self.co_training.weight} of a batch of {self.batch} samples is less than one question"
            )
            raise InvalidInputError("co_training.weight", problem, "Increase the weight or batch, or omit co_training")
        if self.sees == "pixels" and self.history > 1:
            require_asked(self.history_stride, self.execute, "history_stride")

    def _require_family(self) -> None:
        """Reject an unknown family or option."""
        try:
            family = learner_family(self.family)
        except UnknownNameError as error:
            cure = "Pass the file that defines your learner with --task-file"
            raise InvalidInputError("family", str(error).rstrip("."), cure) from error
        for name, value in self.options.items():
            if name not in family.options:
                problem = str(UnknownNameError(f"option of the family {self.family}", name, family.options)).rstrip(".")
                raise InvalidInputError("options", problem, "Leave out the options, or change the family")
            wanted = type(family.options[name])
            if type(value) is not wanted and (wanted, type(value)) != (float, int):
                problem = f"expected {wanted.__name__}, the type of its default, got {value!r}"
                raise InvalidInputError(f"options.{name}", problem, "Correct it")

    def _of_other_families(self) -> tuple[tuple[str, bool], ...]:
        """Return fields that apply to only one family, and whether they are set for another family."""
        changed, pixels = self.augmentation, self.sees == "pixels"
        parts = learner_family(self.family).parts
        return (
            ("eyes", not pixels and self.eyes != Eyes()),
            ("augmentation.shift_px", not pixels and changed.shift_px != Augmentation().shift_px),
            ("augmentation.light", not pixels and changed.light > 0.0),
            ("augmentation.object_noise_m", pixels and changed.object_noise_m > 0.0),
            ("augmentation.shift_m", pixels and changed.shift_m > 0.0),
            *((f"frozen: {part}", part not in parts) for part in self.frozen),
        )

    @property
    def size(self) -> Capacity:
        """The capacity. A name such as ``small`` is looked up in the family."""
        named = learner_family(self.family).capacities
        return named[self.capacity] if isinstance(self.capacity, str) else self.capacity

    @property
    def sees(self) -> Sees:
        """Learner input: the state as objects, or images."""
        return learner_family(self.family).sees

    @property
    def built_in(self) -> bool:
        """Whether the family is built into betterbench."""
        return learner_family(self.family).make is None

    @property
    def all_options(self) -> dict[str, Option]:
        """The family's options, with defaults for options that the recipe does not set."""
        return {**learner_family(self.family).options, **self.options}

    @property
    def shape(self) -> dict[str, object]:
        """Settings that, together with the vocabulary, determine the number of weights, by field name."""
        given = self.proprioception.given
        return {
            "family": self.family,
            "options": self.all_options,
            "capacity": self.size,
            "eyes": len(self.eyes.windows),
            "proprioception": (given, given and self.proprioception.dropout > 0.0),
            "history": self.history if given else None,
            "chunk": self.chunk,
            "loss": self.loss,
        }

    @property
    def questions(self) -> int:
        """Number of questions per step, in addition to the batch."""
        return 0 if self.co_training is None else round(self.co_training.weight * self.batch)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict with all defaults. Unused ``co_training`` and ``options`` are left out."""
        form: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        if self.co_training is None:
            del form["co_training"]  # omitted so that trainings begun before this field existed can be resumed
        if not self.options:
            del form["options"]
        return form


def require_asked(stride: int, execute: int, field_name: str) -> None:
    """Raise InvalidInputError if a pixels learner's history stride is not a multiple of ``execute``."""
    if stride % execute:
        problem = f"{stride} is not a multiple of execute ({execute}), which a pixels learner requires"
        raise InvalidInputError(field_name, problem, "Give a multiple, or history: 1")


_FORM = TypeAdapter(TrainingRecipe)


def read_training_recipe(
    form: object, *, where: str = "recipe", changes: Mapping[str, Any] | None = None
) -> TrainingRecipe:
    """Parse a recipe from JSON.

    Args:
        form: The fields, as a mapping or a JSON string.
        where: File name for errors.
        changes: Fields that override the form. None keeps a field.

    Raises:
        InvalidInputError: If a field is missing, unknown or out of range. The message names it.
    """
    if changes and isinstance(form, Mapping):
        form = {**form, **{name: value for name, value in changes.items() if value is not None}}
    return read_form(_FORM, form, where=where, cure=CURE)
