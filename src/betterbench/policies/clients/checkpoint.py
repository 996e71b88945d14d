"""Loading and inference of LeRobot checkpoints, which consist of weights, processors and a configuration."""

from __future__ import annotations

import contextlib
import copy
import hashlib
import importlib
import re
import sys
import threading
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.errors import BetterError, InvalidInputError, MissingDependencyError, one_line
from betterbench.installation import missing_extra
from betterbench.json_form import parse_json
from betterbench.ordinary_file import open_ordinary, read_ordinary
from betterbench.policies.address import PolicyAddress
from betterbench.policies.clients.checkpoint_code import PROCESSORS, require_no_code
from betterbench.policies.clients.checkpoint_size import bounded_parameters, require_short_horizons
from betterbench.policies.clients.lerobot_types import require_type

_PREPROCESSOR = PROCESSORS[0]
_HUB_ID = re.compile(r"[A-Za-z0-9][\w.-]*/[\w.-]+", re.ASCII)
_INSIDE = "pretrained_model"
_WEIGHTS = "model.safetensors"
_LOADED_FROM = (".json", ".safetensors")

CHUNK_TYPES = ("act", "pi0", "pi05", "smolvla")
"""LeRobot policy types that predict an action chunk from a single observation.

All other types are called at every control step, because they may use earlier observations.
"""

NOISE_TYPES = ("smolvla", "pi0", "pi05")
"""LeRobot policy types that generate actions from random noise.

betterbench draws the noise for each environment separately, so that the actions do not depend on the other observations
in the batch.
"""


@dataclass(frozen=True, slots=True)
class Features:
    """Input and output features that a LeRobot checkpoint declares.

    Attributes:
        images: Size (height, width) of each image [pixel], by feature name.
        states: Length of each state vector, by feature name.
        action: Number of values in an action.
    """

    images: Mapping[str, tuple[int, int]]
    states: Mapping[str, int]
    action: int

    @classmethod
    def of(cls, config: Any, where: str) -> Features:  # noqa: ANN401 - a configuration of LeRobot's
        """Read the features from the configuration of a LeRobot policy.

        Raises InvalidInputError if the policy needs an input that betterbench's observations do not contain, or if its
        output is not a single action vector.
        """
        images, states = {}, {}
        for key, feature in (config.input_features or {}).items():
            kind, shape = str(getattr(feature.type, "value", feature.type)), tuple(feature.shape)
            if kind == "VISUAL" and len(shape) == 3 and shape[0] == 3:
                # Skip placeholders for missing cameras, whose images were empty in training too.
                if "empty_camera" not in key:
                    images[key] = (int(shape[1]), int(shape[2]))
            elif kind == "STATE" and len(shape) == 1 and key.endswith(".state"):
                states[key] = int(shape[0])
            else:
                raise InvalidInputError(
                    where,
                    f"its input {one_line(repr(key), most=100)} has the type {one_line(kind, most=40)} and the "
                    f"shape {one_line(shape, most=100)}, but observations contain no such input",
                    "Train the policy on images (3, height, width), observation.state and the instruction",
                )
        outputs = dict(config.output_features or {})
        shape = tuple(outputs["action"].shape) if "action" in outputs else ()
        if len(shape) != 1:
            raise InvalidInputError(
                where,
                f"the outputs of the checkpoint are {one_line(sorted(outputs), most=200)} instead of one action vector",
                "Use a policy whose only output is 'action'",
            )
        return cls(images, states, int(shape[0]))


class Checkpoint:
    """Network and processors of a loaded checkpoint. Several policies in one process can share a checkpoint.

    ``fingerprint`` is the SHA-256 of the configuration, the weights and the processors. ``lock`` is held during
    inference, so that only one policy uses the network at a time.
    """

    def __init__(self, path: str, device: str | None, where: str, *, trusted: bool = False) -> None:
        """Load a checkpoint from a folder or from the Hugging Face hub onto a device.

        If ``device`` is None, use CUDA or MPS if available, and otherwise the CPU. Call :func:`load_checkpoint` instead
        to reuse a checkpoint that is already loaded. If ``trusted`` is False, a checkpoint that refers to Python code
        outside LeRobot is rejected.

        Raises:
            MissingDependencyError: If LeRobot, or another package that this type of policy needs, is not installed.
            InvalidInputError: If the checkpoint does not exist, cannot be loaded, or refers to Python code but is not
                trusted.
        """
        self._torch = _import("torch")
        factory, configs = _import("lerobot.policies.factory"), _import("lerobot.configs.policies")
        self.lock = threading.Lock()
        self.device = self._choose_device(device, where)
        try:
            # LeRobot prints to stdout while loading, but betterbench's commands print only their results to stdout.
            with contextlib.redirect_stdout(sys.stderr):
                _import("lerobot.policies")  # the import registers the policy types
                known = configs.PreTrainedConfig.get_known_choices()
                if kind := _told_type(path):
                    require_type(kind, known, where)
                self.config = configs.PreTrainedConfig.from_pretrained(path)
                require_type(str(self.config.type), known, where)
                self._check_config(path, where)
                if not trusted:
                    require_no_code(self.config, _processor_files(path), where)
                require_short_horizons(self.config, where)
                self.config.device = self.device
                # The checkpoint contains all weights, so the pretrained weights of the backbone need not be downloaded.
                if getattr(self.config, "pretrained_backbone_weights", None):
                    self.config.pretrained_backbone_weights = None
                self.type = str(self.config.type)
                self.features = Features.of(self.config, where)
                with bounded_parameters(_weights_file(path).stat().st_size, where):
                    made = factory.get_policy_class(self.type).from_pretrained(path, config=self.config)
                self._before, self._after = factory.make_pre_post_processors(
                    self.config,
                    pretrained_path=path,
                    preprocessor_overrides={"device_processor": {"device": self.device}},
                )
        except ImportError as error:
            raise MissingDependencyError(
                f"{where} needs a package that is not installed ({one_line(error)}). Install LeRobot with the extra of "
                f"this policy type. docs/policies.md lists the extras."
            ) from error
        except BetterError:
            raise
        except Exception as error:
            # LeRobot raises many types of exceptions for an unusable checkpoint. Report all of them as one line.
            problem = one_line(error, most=300) or type(error).__name__
            raise InvalidInputError(
                where,
                f"LeRobot cannot load the checkpoint ({problem})",
                "Use the folder or hub ID of a checkpoint of LeRobot 0.4 or newer",
            ) from error
        self.policy = made.to(self.device).eval()
        self.versions = {name: str(_import(name).__version__) for name in ("lerobot", "torch")}
        self.fingerprint = _fingerprint(path)

    def _choose_device(self, device: str | None, where: str) -> str:
        torch = self._torch
        if device is None:
            mps = getattr(torch.backends, "mps", None)
            return "cuda" if torch.cuda.is_available() else "mps" if mps and mps.is_available() else "cpu"
        try:
            torch.zeros(1, device=device)
        except (RuntimeError, AssertionError, ValueError) as error:
            problem = " ".join(str(error).split())[:160]
            raise InvalidInputError(
                where, f"device={device} cannot be used ({problem})", "Use cpu, cuda or cuda:N, or omit device"
            ) from error
        return device

    def _check_config(self, path: str, where: str) -> None:
        if getattr(self.config, "use_peft", False):
            raise InvalidInputError(
                where,
                "the checkpoint contains only a PEFT adapter",
                "Merge the adapter into its base model and save the result",
            )
        folder = Path(path)
        if folder.is_dir() and not (folder / _PREPROCESSOR).is_file():
            raise InvalidInputError(
                where,
                f"{_PREPROCESSOR} is missing, so the normalization is unknown",
                "Convert a checkpoint saved before LeRobot 0.4 with lerobot.processor.migrate_policy_normalization",
            )

    def sibling(self) -> Any:  # noqa: ANN401 - a policy of LeRobot's
        """Return a policy that shares the weights of this checkpoint but has its own observation history."""
        # A shallow copy shares the modules, and reset() replaces only the observation history of the copy.
        made = copy.copy(self.policy)
        made.reset()
        return made

    def chunks(self, batch: Mapping[str, Any], seeds: Sequence[int]) -> np.ndarray:
        """Compute the action chunks of several environments at once.

        Args:
            batch: Images (B, 3, H, W) float32 in [0, 1], states (B, size) float32, and the list of instructions as
                "task".
            seeds: One seed per environment, for policies that generate actions from noise.

        Returns:
            Action chunks as an array (B, horizon, dim) float64, in the units of the training data.
        """
        torch = self._torch
        with self.lock, torch.inference_mode(), self._precision():
            prepared = self._before(dict(batch))
            extra = {"noise": self._noise(seeds)} if self.type in NOISE_TYPES else {}
            raw = self.policy.predict_action_chunk(prepared, **extra)
            # The processors expect a batch of single actions, so each action of a chunk becomes one row of the batch.
            done = self._after(raw.reshape(-1, raw.shape[-1]))
        actions = done.reshape(*raw.shape[:2], -1)[..., : self.features.action]
        return np.asarray(actions.float().cpu().numpy(), dtype=np.float64)

    def step(self, policy: Any, batch: Mapping[str, Any], seed: int) -> np.ndarray:  # noqa: ANN401 - LeRobot's
        """Return the next action of one environment as an array (1, dim) float64."""
        torch = self._torch
        devices = [torch.device(self.device)] if self.device.startswith("cuda") else []
        with self.lock, torch.inference_mode(), self._precision(), torch.random.fork_rng(devices):
            torch.manual_seed(seed)
            done = self._after(policy.select_action(self._before(dict(batch))))
        return np.asarray(done.float().cpu().numpy(), dtype=np.float64).reshape(1, -1)[:, : self.features.action]

    def tensor(self, array: np.ndarray) -> Any:  # noqa: ANN401 - a tensor
        """Convert a numpy array to a torch tensor."""
        return self._torch.from_numpy(array)

    def _precision(self) -> contextlib.AbstractContextManager[Any]:
        if getattr(self.config, "use_amp", False):
            amp: contextlib.AbstractContextManager[Any] = self._torch.autocast(self.device.partition(":")[0])
            return amp
        return contextlib.nullcontext()

    def _noise(self, seeds: Sequence[int]) -> Any:  # noqa: ANN401 - a tensor
        shape = (int(self.config.chunk_size), int(self.config.max_action_dim))
        drawn = [np.random.default_rng(seed).standard_normal(shape, dtype=np.float32) for seed in seeds]
        return self._torch.from_numpy(np.stack(drawn)).to(self.device)


_LOADED: weakref.WeakValueDictionary[tuple[str, str | None, bool], Checkpoint] = weakref.WeakValueDictionary()
_LOADING = threading.Lock()


def load_checkpoint(address: PolicyAddress) -> Checkpoint:
    """Load the checkpoint of a policy address, or return it if a policy in this process has already loaded it.

    Raises the errors of :class:`Checkpoint`.
    """
    where = f"policy {address}"
    _import("torch")
    _import("lerobot")
    path = _located(address.target, where)
    trusted = address.choice("trust", ("true", "false"), "false") == "true"
    key = (path, address.options.get("device"), trusted)
    with _LOADING:
        found = _LOADED.get(key)
        if found is None:
            found = Checkpoint(path, address.options.get("device"), where, trusted=trusted)
            _LOADED[key] = found
        return found


def _processor_files(path: str) -> dict[str, Path]:
    """Return the paths of a checkpoint's processor files, by name. Download the files of a checkpoint on the hub.

    Missing files are omitted, because LeRobot reports them when it loads the checkpoint.
    """
    folder = Path(path)
    if folder.is_dir():
        return {name: folder / name for name in PROCESSORS if (folder / name).exists()}
    hub, errors, found = _import("huggingface_hub"), _import("huggingface_hub.errors"), {}
    for name in PROCESSORS:
        try:
            found[name] = Path(hub.hf_hub_download(path, name))
        except errors.EntryNotFoundError as error:
            # A failed download does not mean that the file is missing. LeRobot could still download and use the file,
            # so it must not skip the check for code.
            if isinstance(error, errors.LocalEntryNotFoundError):
                raise
    return found


def _weights_file(path: str) -> Path:
    """Return the path of a checkpoint's weights file. Download the file if the checkpoint is on the hub."""
    if Path(path).is_dir():
        return Path(path) / _WEIGHTS
    return Path(_import("huggingface_hub").hf_hub_download(path, _WEIGHTS))


def _fingerprint(path: str) -> str:
    """Return the SHA-256 of the checkpoint's JSON and safetensors files."""
    folder = Path(path)
    if not folder.is_dir():
        folder = Path(_import("huggingface_hub").snapshot_download(path, local_files_only=True))
    whole = hashlib.sha256()
    for file in sorted(f for f in folder.iterdir() if f.suffix in _LOADED_FROM):
        whole.update(f"{file.name}\n".encode())
        with open_ordinary(file) as opened:
            whole.update(hashlib.file_digest(opened, "sha256").digest())
    return whole.hexdigest()


def _told_type(path: str) -> str:
    """Return the policy type in a checkpoint folder's config.json, or an empty string for a checkpoint on the hub."""
    file = Path(path) / "config.json"
    form = parse_json(read_ordinary(file)) if file.is_file() else {}
    return str(form.get("type", "")) if isinstance(form, dict) else ""


def _located(target: str, where: str) -> str:
    """Return the folder that contains a checkpoint's configuration, or the ID of a checkpoint on the hub."""
    folder = Path(target).expanduser()
    if (folder / _INSIDE / "config.json").is_file():
        folder /= _INSIDE
    if (folder / "config.json").is_file():
        _check_form(folder / "config.json", where)
        return str(folder.resolve())
    if folder.exists() or not _HUB_ID.fullmatch(target):
        there = "contains no config.json" if folder.exists() else "does not exist"
        raise InvalidInputError(
            where,
            f"{target} {there}",
            "Use the path of a folder pretrained_model saved by LeRobot, or OWNER/NAME of a checkpoint on the hub",
        )
    return target


def _check_form(file: Path, where: str) -> None:
    try:
        form = parse_json(read_ordinary(file))
    except (OSError, ValueError) as error:
        raise InvalidInputError(where, f"{file.name} cannot be read ({error})", "Save the checkpoint again") from error
    if not isinstance(form, dict) or not isinstance(form.get("type"), str):
        raise InvalidInputError(
            where,
            f"{file.name} has no policy type, so this is not a LeRobot checkpoint",
            "Use the folder of a LeRobot checkpoint",
        )


def _import(name: str) -> Any:  # noqa: ANN401 - LeRobot is not installed where types are checked
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise missing_extra(
            f"lerobot: needs LeRobot, which is not installed ({error})",
            "lerobot",
            otherwise="or serve the checkpoint from an environment that has it: better serve lerobot:CHECKPOINT.",
        ) from error
