"""Training recipes, which contain all settings that determine the weights of a learner."""

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
        given: Whether the learner gets the pose of the tool, the opening of the fingers, and inputs computed from them.
        noise_m: Standard deviation of the noise added to the position of the tool in training [m].
        dropout: Fraction of training samples from which all proprioceptive inputs are removed.
    """

    given: bool = True
    noise_m: _Length = 0.0
    dropout: _Share = 0.0


@strict_form
@dataclass(frozen=True, slots=True)
class Augmentation:
    """Random augmentation of training samples.

    The first two settings apply to the family ``objects``, the last two to the family ``pixels``.

    Attributes:
        object_noise_m: Standard deviation of the noise added to the position of each object [m].
        shift_m: Maximum distance along x and along y by which the tool and all objects are shifted together [m].
        shift_px: Maximum shift of an image along each axis [pixel]. The uncovered border is filled with the edge
            pixels. This is equivalent to padding followed by a random crop.
        light: Standard deviation of random changes to the contrast and brightness of images, as a fraction of the full
            range.
    """

    object_noise_m: _Length = 0.0
    shift_m: _Length = 0.0
    shift_px: Annotated[int, Field(ge=0, le=64)] = 4
    light: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0


@strict_form
@dataclass(frozen=True, slots=True)
class View:
    """Image input of a learner in the ``pixels`` family, which is the image of a camera or a part of this image.

    Attributes:
        camera: Name of the camera.
        window: Left, top, right and bottom edge of the crop, as fractions of the camera image. The crop is scaled to
            the size of the network's input. A crop of exactly that size is copied pixel by pixel.
    """

    camera: str
    window: tuple[_Edge, _Edge, _Edge, _Edge] = _WHOLE

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the window is empty or too small."""
        left, top, right, bottom = self.window
        if right - left < _LEAST_WINDOW or bottom - top < _LEAST_WINDOW:
            problem = f"{list(self.window)} is empty or too small"
            raise InvalidInputError("window", problem, "Write the window as left, top, right, bottom, each from 0 to 1")


@strict_form
@dataclass(frozen=True, slots=True)
class Eyes:
    """Image inputs of a learner in the ``pixels`` family.

    Attributes:
        observation: Name of the observation preset that contains the cameras. Evaluation must use the same preset.
        views: Image inputs. Each is given as the name of a camera, or as a camera with a window.
        size: Side length of the input images of the network [pixel].
        quality: Rendering quality of the training images.
    """

    observation: str = "default"
    views: Annotated[tuple[str | View, ...], Field(min_length=1, max_length=8)] = ("front", "wrist")
    size: Annotated[int, Field(ge=16, le=256, multiple_of=8)] = 96
    quality: Literal["fast", "standard", "high"] = "standard"

    def __post_init__(self) -> None:
        """Raise an error if the observation preset does not contain one of the cameras."""
        try:
            observation_spec(self.observation).only(self.cameras)
        except UnknownNameError as error:
            raise InvalidInputError(
                "eyes", str(error).rstrip("."), "Use cameras that the observation preset contains"
            ) from error

    @property
    def windows(self) -> tuple[View, ...]:
        """All image inputs, each as a camera with a window."""
        return tuple(View(view) if isinstance(view, str) else view for view in self.views)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the cameras to render, each listed once."""
        return tuple(dict.fromkeys(view.camera for view in self.windows))


@strict_form
@dataclass(frozen=True, slots=True)
class CoTraining:
    """Questions that the network learns to answer in addition to predicting actions.

    Attributes:
        sets: Folders written by ``better vqa``, with questions about the training demonstrations.
        weight: Number of questions per frame with actions. In the paper, actions are sampled with weight 8.0 and each
            of four sets of texts with weight 0.5 (appendix A.2), which corresponds to 0.25.
    """

    sets: Annotated[tuple[str, ...], Field(min_length=1)]
    weight: Annotated[float, Field(gt=0.0, le=10.0)] = 0.25


@strict_form
@dataclass(frozen=True, slots=True)
class TrainingRecipe:
    """Recipe for training a learner: data, network, optimization and validation.

    Attributes:
        data: Folders written by ``better dataset``, or runs of ``better collect``, ``amplify`` or ``teleop``.
        family: Family of the learner. ``objects`` gets poses, sizes, categories and colors, as from a perfect detector.
            ``pixels`` gets images. It may also be the name of a family that a user has defined.
        options: Options of a family that a user has defined.
        tasks: Tasks whose demonstrations are used. If empty, all tasks in the data are used.
        variations: Whether demonstrations of test variations are used, too. If so, the training distribution covers the
            tests.
        demonstrations: Maximum number of demonstrations per condition. Those with the lowest seeds are used. None means
            that all are used.
        longest_pause: Maximum number of control steps that are used from each pause of the demonstrator. None means
            that all are used.
        every: Number of control steps between input frames in training. The actions of a chunk are always consecutive.
        eyes: Image inputs of a ``pixels`` learner.
        capacity: Size of the transformer, as ``small``, ``base`` or ``large``, or as width, layers and heads.
        proprioception: Proprioceptive inputs.
        augmentation: Random augmentation of training samples.
        history: Number of tool states in the input: the present state and earlier states.
        history_stride: Number of control steps between the tool states in the history. For a ``pixels`` learner, which
            gets an observation every ``execute`` steps, it must be a multiple of ``execute``.
        chunk: Number of actions in a chunk.
        execute: Execution horizon: the number of actions of each chunk that are executed before the learner predicts
            the next chunk.
        loss: Loss function, ``l1`` or ``flow`` (flow matching).
        flow_steps: Number of integration steps when an action chunk is sampled from a flow.
        dropout: Fraction of activations that are dropped in training.
        gripper_weight: Sampling weight of a sample at which the gripper opens or closes. Other samples have weight 1.
        co_training: Questions that are learned in addition to actions, or None.
        start: Checkpoint from which the initial weights are taken, or None.
        frozen: Parts of the network whose weights are not trained.
        steps: Number of training steps.
        batch: Number of samples per training step.
        learning_rate: Maximum learning rate of AdamW, which is reached after ``warmup`` steps. The learning rate then
            decays to zero with a cosine schedule.
        warmup: Number of steps during which the learning rate increases.
        weight_decay: Weight decay of AdamW.
        ema: Decay rate of the exponential moving average of the weights. Evaluation uses the averaged weights.
        clip: Maximum norm of the gradient.
        seed: Seed for the initial weights and for the random choices in training.
        validation: Fraction of seeds that are held out for validation. They are chosen in the same way as by ``better
            export --validation``.
        validate_every: Number of training steps between two validations.
        rollouts: Number of rollouts in each validation. They start from the initial states of held-out demonstrations.
        save_every: Number of training steps between two saved states from which training can be resumed.
        threads: Number of threads per process. The weights are reproducible only with the same number of threads.
        version: Version of the training procedure.
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
        """Raise an error if settings contradict each other, or if the family does not support a setting."""
        self._require_family()
        if self.execute > self.chunk:
            problem = f"{self.execute} is more than the {self.chunk} actions of a chunk"
            raise InvalidInputError("execute", problem, "Use at most that number")
        if self.start is None and self.frozen:
            raise InvalidInputError("frozen", "frozen parts would keep random weights", "Set start to a checkpoint")
        foreign = next((f"{name}" for name, theirs in self._of_other_families() if theirs), None)
        if foreign is not None:
            problem = f"learners of the family {self.family} do not have this setting"
            raise InvalidInputError(foreign, problem, "Omit this field, or change the family")
        parts = set(learner_family(self.family).parts) - (set() if self.proprioception.given else {"state"})
        if parts <= set(self.frozen) and self.built_in:
            raise InvalidInputError("frozen", "all parts are frozen", "Freeze fewer parts")
        if self.co_training is not None and self.questions == 0:
            problem = (
                f"a weight of {self.co_training.weight} and a batch of {self.batch} samples give less than one "
                "question per step"
            )
            raise InvalidInputError("co_training.weight", problem, "Increase the weight or batch, or omit co_training")
        if self.sees == "pixels" and self.history > 1:
            require_asked(self.history_stride, self.execute, "history_stride")

    def _require_family(self) -> None:
        """Raise an error if the family or one of its options is unknown."""
        try:
            family = learner_family(self.family)
        except UnknownNameError as error:
            cure = "Pass the file that defines your learner with --task-file"
            raise InvalidInputError("family", str(error).rstrip("."), cure) from error
        for name, value in self.options.items():
            if name not in family.options:
                problem = str(UnknownNameError(f"option of the family {self.family}", name, family.options)).rstrip(".")
                raise InvalidInputError("options", problem, "Omit the option, or change the family")
            wanted = type(family.options[name])
            if type(value) is not wanted and (wanted, type(value)) != (float, int):
                problem = f"expected {wanted.__name__}, the type of its default, got {value!r}"
                raise InvalidInputError(f"options.{name}", problem, "Correct the value")

    def _of_other_families(self) -> tuple[tuple[str, bool], ...]:
        """Return the fields that only one family uses, each with whether this recipe sets it for another family."""
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
        """Size of the transformer. A name such as ``small`` is looked up in the family."""
        named = learner_family(self.family).capacities
        return named[self.capacity] if isinstance(self.capacity, str) else self.capacity

    @property
    def sees(self) -> Sees:
        """Kind of input that the learner gets: objects or images."""
        return learner_family(self.family).sees

    @property
    def built_in(self) -> bool:
        """Whether the family is built into betterbench."""
        return learner_family(self.family).make is None

    @property
    def all_options(self) -> dict[str, Option]:
        """Options of the family. Options that the recipe does not set have their default values."""
        return {**learner_family(self.family).options, **self.options}

    @property
    def shape(self) -> dict[str, object]:
        """Settings by name that, together with the vocabulary, determine the shapes of the network's weights."""
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
        """Number of questions in each training step. They are added to the samples of the batch."""
        return 0 if self.co_training is None else round(self.co_training.weight * self.batch)

    def to_json(self) -> dict[str, Any]:
        """Return the recipe as a JSON-serializable dict that includes all defaults.

        ``co_training`` and ``options`` are left out if they are not used.
        """
        form: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        if self.co_training is None:
            del form["co_training"]  # omitted so that a training begun before this field existed can be resumed
        if not self.options:
            del form["options"]
        return form


def require_asked(stride: int, execute: int, field_name: str) -> None:
    """Raise InvalidInputError if the history stride of a ``pixels`` learner is not a multiple of ``execute``."""
    if stride % execute:
        problem = f"{stride} is not a multiple of execute ({execute}), which a pixels learner requires"
        raise InvalidInputError(field_name, problem, "Use a multiple of execute, or set history to 1")


_FORM = TypeAdapter(TrainingRecipe)


def read_training_recipe(
    form: object, *, where: str = "recipe", changes: Mapping[str, Any] | None = None
) -> TrainingRecipe:
    """Parse a training recipe given as JSON.

    Args:
        form: Recipe as a mapping or as a JSON string.
        where: Name of the file, used in messages.
        changes: New values of fields, which replace those in the recipe. A field for which None is given is not
            replaced.

    Raises:
        InvalidInputError: If a field is missing, unknown or out of range. The message names the field.
    """
    if changes and isinstance(form, Mapping):
        form = {**form, **{name: value for name, value in changes.items() if value is not None}}
    return read_form(_FORM, form, where=where, cure=CURE)
