"""Training loop.

Each step depends only on the weights, the seed and the index of the step. An interrupted training run can therefore be
resumed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Annotated, Any

import torch
import torch.distributed
from pydantic import Field, TypeAdapter
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from betterbench.errors import InvalidInputError, TrainingError, one_line
from betterbench.jobs import job_folder, write_durably
from betterbench.jobs.conflict import first_difference, require_free, require_same
from betterbench.jobs.durable import on_disk
from betterbench.json_form import file_digest, read_form, read_object, strict_form
from betterbench.learning.training.batches import Batches
from betterbench.learning.training.curves import Log, LossRow
from betterbench.learning.training.data import TrainingSet, scales_of
from betterbench.learning.training.processes import TrainingProcesses
from betterbench.learning.training.validation import phase_errors, right_answers, roll_out, rollout_trials
from betterbench.policies.learned.checkpoint import (
    FILE_NAME,
    Trained,
    checkpoint_file,
    load_weights,
    read_tensors,
    require_code,
    write_checkpoint,
    write_tensors,
)
from betterbench.policies.learned.network import LearnerNetwork
from betterbench.policies.learned.networks import new_network
from betterbench.policies.learned.policy import Learner
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.records.run import keep_copies
from betterbench.tasks.user_files import code_of, explaining

STATE_NAME = "state.safetensors"
"""File from which training is resumed: weights, the moving average of the weights, and the moments of the optimizer."""
_RECIPE_NAME = "recipe.json"
_MAX_RECIPE = 1 << 20
_ROW_STEPS = 50
_BETAS = (0.9, 0.95)
_STATE_CURE = "Train into another folder, or restore the file"
_CURES = {
    "torch": "Continue with the same version of torch",
    "device": "Continue with the same --device",
    "processes": "Continue with the same number of processes",
    "learner": "Continue with the learner's original file; a copy of it is in task_files",
}
"""Remedies to suggest if a setting has changed when a training run is resumed, by setting.

Recipe and data are not included.
"""
_PATIENCE = timedelta(hours=6)
"""Maximum time that the other processes wait for the first process while it validates and writes files."""


@dataclass(frozen=True, slots=True)
class TrainingProgress:
    """Progress of a training run.

    Attributes:
        step: Number of finished steps, including those before an interruption.
        steps: Total number of steps, as stated in the recipe.
        loss: Mean loss over the most recent steps.
        samples_per_s: Training samples per second since training was started or resumed, without validation.
    """

    step: int
    steps: int
    loss: float
    samples_per_s: float


OnTraining = Callable[[TrainingProgress], None]


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """Result of a complete training run.

    Attributes:
        checkpoint: Checkpoint file of the policy.
        parameters: Number of trained parameters.
        log: Tables that log the training run.
        seconds: Time since training was started or resumed, without reading the data [s].
        samples_per_s: Training samples per second in this time, without validation; 0 if the training run was already
            complete.
    """

    checkpoint: Path
    parameters: int
    log: Log
    seconds: float
    samples_per_s: float


def train(
    recipe: TrainingRecipe,
    data: TrainingSet,
    out: Path,
    *,
    device: str = "cpu",
    on_progress: OnTraining | None = None,
) -> TrainingResult:
    """Train a policy according to a recipe, or resume an interrupted training run.

    On the same machine and with the same numbers of threads and processes, the weights are bit-identical with and
    without interruptions.

    Raises:
        RunConflictError: If the folder contains another training run, or another process writes to it.
        TrainingError: If the loss is not finite. The saved state is kept.
        InvalidInputError: If the saved state is damaged, or the device cannot be used.
        StorageError: If the disk is full, or the folder was removed or renamed during the training. The saved state is
            kept.
    """
    world = TrainingProcesses.here()
    require_place(out, device)
    if recipe.batch % world.size:
        raise InvalidInputError(
            "batch",
            f"{recipe.batch} is not a multiple of the number of processes ({world.size})",
            "Change the batch size",
        )
    if recipe.questions % world.size:
        problem = f"{recipe.questions} questions cannot be divided evenly among {world.size} processes"
        raise InvalidInputError("co_training.weight", problem, "Change the weight")
    form = {
        "recipe": recipe.to_json(),
        "data": data.sha256,
        "start": None if recipe.start is None else file_digest(checkpoint_file(recipe.start)),
        "torch": str(torch.__version__),
        "device": device.partition(":")[0],
        "processes": world.size,
    }
    if (code := code_of("family", recipe.family)) is not None:
        form["learner"] = code
    with contextlib.ExitStack() as stack:
        if world.rank == 0:
            stack.enter_context(job_folder(out))
            _keep_recipe(form, out)
            if code is not None:
                keep_copies(out)
        stack.enter_context(_deterministic(recipe.threads))
        stack.enter_context(_together(world, device))
        return _Training(recipe, data, out, world.device(device), world, identity=_identity(form)).run(on_progress)


def require_place(out: Path, device: str) -> None:
    """Check the output folder and the device before any data are read.

    Raises:
        RunConflictError: If the folder contains other files.
        InvalidInputError: If the device cannot be used.
    """
    _require_device(TrainingProcesses.here().device(device))
    require_free(out, "training", file=_RECIPE_NAME)


class _Training:
    """Training run in progress, with its network, optimizer, data and logs."""

    def __init__(
        self,
        recipe: TrainingRecipe,
        data: TrainingSet,
        out: Path,
        device: str,
        world: TrainingProcesses,
        *,
        identity: str,
    ) -> None:
        self._recipe, self._data, self._out, self._device, self._world = recipe, data, out, device, world
        self._identity = identity
        self._batches = Batches(data, recipe, device)
        torch.manual_seed(recipe.seed)
        self._network = new_network(recipe, data.vocabulary)
        scales = scales_of(data)
        buffers = dict(self._network.named_buffers())
        for name in buffers.keys() & scales.keys():
            buffers[name].copy_(torch.from_numpy(scales[name]))
        if recipe.start is not None:
            _begin_with(self._network, checkpoint_file(recipe.start), data)
        for part, parameters in self._network.parts().items():
            for parameter in parameters:
                if part in recipe.frozen:
                    parameter.requires_grad_(False)
        self._network.to(device)
        self._trained = {n: p for n, p in self._network.named_parameters() if p.requires_grad}
        if not self._trained:
            raise InvalidInputError("frozen", "all parameters are frozen", "Freeze fewer parts")
        self._mean = {name: tensor.detach().clone() for name, tensor in self._network.state_dict().items()}
        self._running = {name for name in buffers if name not in scales and name in self._mean}
        self._optimizer = torch.optim.AdamW(
            self._trained.values(), lr=recipe.learning_rate, betas=_BETAS, weight_decay=recipe.weight_decay
        )
        self._step, self._log = 0, Log()
        self._rows: list[list[float]] = []  # loss and gradient norm over the steps since the last log row
        if (out / STATE_NAME).exists():
            self._restore()

    def run(self, on_progress: OnTraining | None) -> TrainingResult:
        """Train to the last step, and write the checkpoint."""
        recipe, began = self._recipe, time.perf_counter()
        first, busy = self._step, 0.0
        shared: nn.Module = self._network
        if self._world.size > 1:
            shared = DistributedDataParallel(self._network)
        while self._step < recipe.steps:
            at = time.perf_counter()
            self._rows.append(self._advance(shared))
            busy += time.perf_counter() - at
            done, ended = self._step, self._step == recipe.steps
            if done % _ROW_STEPS == 0 or ended:
                means = [sum(values) / len(self._rows) for values in zip(*self._rows, strict=True)]
                self._log.losses.append(LossRow(done, round(means[0], 6), self._rate(done - 1), round(means[1], 6)))
                self._rows = []
                if on_progress is not None and self._world.rank == 0:
                    speed = (done - first) * recipe.batch / busy
                    on_progress(TrainingProgress(done, recipe.steps, means[0], speed))
            if done % recipe.validate_every == 0 or ended:
                self._validate()
            if done % recipe.save_every == 0 or ended:
                self._save()
        checkpoint = self._out / FILE_NAME
        if self._world.rank == 0:
            write_checkpoint(checkpoint, self._mean, self._about())
            self._log.write(self._out)
        count = sum(p.numel() for p in self._trained.values())
        speed = (self._step - first) * recipe.batch / busy if busy else 0.0
        return TrainingResult(checkpoint, count, self._log, time.perf_counter() - began, speed)

    def _advance(self, shared: nn.Module) -> list[float]:
        """Take one optimization step. Return the loss and the gradient norm."""
        recipe, world = self._recipe, self._world
        torch.manual_seed(_step_seed(recipe.seed, self._step, world.rank))
        self._network.train()
        for part in () if recipe.built_in else recipe.frozen:  # so that a frozen batch norm layer keeps its statistics
            if isinstance(module := getattr(self._network, part, None), nn.Module):
                module.eval()
        shown, actions, counted = self._batches.sample(
            self._batches.drawn(self._step, world.rank, world.size), training=True
        )
        asked = None
        if recipe.questions:
            chosen = self._batches.drawn_questions(self._step, world.rank, world.size)
            asked = self._batches.questions(chosen, training=True)
        with explaining("family", recipe.family):
            loss = shared(shown, actions, counted, asked)
        if not recipe.built_in:
            self._require_sound(loss)
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        for name, weight in self._trained.items():
            where = f"learner {recipe.family!r}"
            if weight.grad is None:
                raise InvalidInputError(
                    where,
                    f"the loss does not depend on the weights {name}",
                    "Use these weights in the loss, or remove them",
                )
            if weight.grad.is_sparse:
                raise InvalidInputError(where, f"the gradient of {name} is sparse", "Use layers with dense gradients")
        norm = nn.utils.clip_grad_norm_(self._trained.values(), recipe.clip)
        found = [float(loss.detach()), float(norm)]
        if not all(math.isfinite(value) for value in found):
            raise TrainingError(
                f"step {self._step + 1}: the loss is {found[0]} and its gradient {found[1]}, so training cannot "
                f"continue. The state saved in {self._out} is kept. Train in another folder with a smaller "
                f"learning_rate or clip."
            )
        for group in self._optimizer.param_groups:
            group["lr"] = self._rate(self._step)
        self._optimizer.step()
        self._step += 1
        self._follow()
        return found

    def _require_sound(self, loss: object) -> None:
        """Raise InvalidInputError if a user's learner has an invalid loss, or creates weights after ``build``."""
        where = f"learner {self._recipe.family!r}"
        if not isinstance(loss, Tensor) or loss.shape != () or not loss.requires_grad:
            raise InvalidInputError(
                where, "its loss is not a scalar tensor that depends on the weights", "Correct the method loss"
            )
        new = sorted(self._network.state_dict().keys() ^ self._mean.keys())
        if new:
            raise InvalidInputError(
                where, f"{new[0]} was created after build", "Create all modules in the method build"
            )

    def _rate(self, step: int) -> float:
        """Return the learning rate at a step. The first step has the index 0."""
        recipe = self._recipe
        if step < recipe.warmup:
            return recipe.learning_rate * (step + 1) / recipe.warmup
        share = (step - recipe.warmup) / max(1, recipe.steps - recipe.warmup)
        return recipe.learning_rate * 0.5 * (1.0 + math.cos(math.pi * share))

    def _follow(self) -> None:
        """Update the moving average of the weights.

        In the first steps, the average follows the weights faster, because it starts from random weights.

        Buffers of a user's learner, such as those of a batch norm, are copied instead of averaged.
        """
        decay = min(self._recipe.ema, (1.0 + self._step) / (10.0 + self._step))
        with torch.no_grad():
            names = list(self._trained)
            torch._foreach_lerp_(
                [self._mean[name] for name in names], [self._trained[name].detach() for name in names], 1.0 - decay
            )
            for name, buffer in self._network.named_buffers() if self._running else ():
                if name in self._running:
                    self._mean[name].copy_(buffer)

    def _about(self) -> Trained:
        code = code_of("family", self._recipe.family)
        return Trained(self._recipe, self._data.vocabulary, self._step, self._data.sha256, code=code)

    def _validate(self) -> None:
        """Log the validation errors of the averaged weights by phase, and the outcomes of a few rollouts."""
        if self._world.rank:
            return
        network = new_network(self._recipe, self._data.vocabulary).to(self._device)
        network.load_state_dict(self._mean)
        network.eval()
        self._log.errors += phase_errors(network, self._batches, self._data, self._recipe, self._step)
        self._log.answers += right_answers(network, self._batches, self._data, self._step)
        learner = Learner(network, self._about())
        for trial in rollout_trials(self._data, self._recipe.rollouts):
            self._log.rollouts.append(roll_out(learner, trial, self._step))

    def _save(self) -> None:
        """Write the tables, and then the state for resuming the training."""
        if self._world.rank:
            return
        self._log.write(self._out)
        tensors = {f"weights/{name}": tensor for name, tensor in self._network.state_dict().items()}
        tensors |= {f"mean/{name}": tensor for name, tensor in self._mean.items()}
        for name, parameter in self._trained.items():
            moments = self._optimizer.state[parameter]
            tensors |= {f"first/{name}": moments["exp_avg"], f"second/{name}": moments["exp_avg_sq"]}
        about = {"step": self._step, "rows": self._rows, "training": self._identity, "log": self._log.digest()}
        write_tensors(self._out / STATE_NAME, tensors, about)

    def _restore(self) -> None:
        """Restore the saved state. Raises InvalidInputError if the state belongs to another training run."""
        path = self._out / STATE_NAME
        tensors, about = read_tensors(path, cure=_STATE_CURE)
        if about.get("training") != self._identity:
            raise InvalidInputError(str(path), "the saved state belongs to another training run", _STATE_CURE)
        state = read_form(_STATE, about, where=str(path), cure=_STATE_CURE)
        if state.step > self._recipe.steps:
            raise InvalidInputError(
                f"{path}: step",
                f"the saved state is beyond the {self._recipe.steps} steps of the recipe",
                _STATE_CURE,
            )
        parts: dict[str, dict[str, Tensor]] = {"weights": {}, "mean": {}, "first": {}, "second": {}}
        for name, tensor in tensors.items():
            part, _, rest = name.partition("/")
            parts.setdefault(part, {})[rest] = tensor.to(self._device)
        load_weights(self._network, parts["weights"], str(path))
        _require_like(parts.pop("mean"), self._mean, f"{path}: mean")
        for part in ("first", "second"):
            _require_like(parts[part], self._trained, f"{path}: {part}")
        self._mean = {name: tensors[f"mean/{name}"].to(self._device) for name in self._mean}
        self._step, self._rows = state.step, state.rows
        for name, parameter in self._trained.items():
            self._optimizer.state[parameter] = {
                "step": torch.tensor(float(self._step)),
                "exp_avg": parts["first"][name],
                "exp_avg_sq": parts["second"][name],
            }
        self._log = Log.read(self._out, self._step)
        if state.log not in (None, self._log.digest()):
            problem = "the tables of the training do not match the saved state"
            raise InvalidInputError(str(self._out), problem, _STATE_CURE)


@strict_form
@dataclass(frozen=True, slots=True)
class _State:
    """Metadata of a saved training state. State files from earlier versions have no digest of the log tables."""

    step: Annotated[int, Field(ge=0, lt=1 << 53)]
    rows: list[Annotated[list[float], Field(min_length=2, max_length=2)]]
    training: str
    log: str | None = None


_STATE = TypeAdapter(_State)


def _require_like(there: Mapping[str, Tensor], wanted: Mapping[str, Tensor], where: str) -> None:
    """Raise InvalidInputError unless two sets of tensors have the same names, shapes and types."""
    forms = [{n: (tuple(t.shape), t.dtype) for n, t in some.items()} for some in (there, wanted)]
    if forms[0] != forms[1]:
        names = sorted(n for n in forms[0].keys() ^ forms[1].keys()) or ["a shape"]
        raise InvalidInputError(
            where, f"it does not fit the learner ({one_line(names[0], most=80)} differs)", _STATE_CURE
        )


def _begin_with(network: LearnerNetwork, start: Path, data: TrainingSet) -> None:
    """Load the initial weights from a checkpoint, which must have the same vocabulary as the data."""
    weights, about = read_tensors(start)
    require_code(about, f"start: {start}")
    known = first_difference(about.get("vocabulary"), data.vocabulary.to_json(), "vocabulary")
    if known is not None:
        problem = f"its vocabulary differs: {known[0]} is {known[1]} in the checkpoint and {known[2]} in the data"
        raise InvalidInputError(f"start: {start}", problem, "Start from a checkpoint with the same vocabulary")
    load_weights(network, weights, f"start: {start}")


def _keep_recipe(form: Mapping[str, Any], out: Path) -> None:
    """Write the settings of the training run into its folder.

    Raises RunConflictError if the folder contains different settings.
    """
    path = out / _RECIPE_NAME
    if path.exists():
        there = read_object(path, max_bytes=_MAX_RECIPE, cure="Choose another folder")
        cure = "Continue with the same recipe and data"
        require_same(out, _wherever(there), _wherever(form), "training", where="training", cure=cure, cures=_CURES)
        if there == form:
            return
    with on_disk(out):
        write_durably(path, (json.dumps(form, indent=1) + "\n").encode())


def _identity(form: Mapping[str, Any]) -> str:
    """Return a hash of all settings that determine the weights."""
    return hashlib.sha256(json.dumps(_wherever(form), sort_keys=True).encode()).hexdigest()


def _wherever(form: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings without the paths of the input files. The inputs are identified by their hashes instead."""
    recipe = form.get("recipe")
    if not isinstance(recipe, dict):
        return dict(form)
    recipe = {name: value for name, value in recipe.items() if name not in {"data", "start"}}
    if isinstance(asking := recipe.get("co_training"), dict):
        recipe["co_training"] = {name: value for name, value in asking.items() if name != "sets"}
    return {**form, "recipe": recipe}


def _require_device(device: str) -> None:
    try:
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError, ValueError) as error:
        problem = f"this device cannot be used ({' '.join(str(error).split())[:160]})"
        raise InvalidInputError(f"--device {device}", problem, "Use cpu, or cuda on a machine with a GPU") from error


@contextlib.contextmanager
def _deterministic(threads: int) -> Iterator[None]:
    """Context manager that fixes the number of threads, and restores torch's random state at the end."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with torch.random.fork_rng():
            yield
    finally:
        torch.set_num_threads(before)


@contextlib.contextmanager
def _together(world: TrainingProcesses, device: str) -> Iterator[None]:
    """Context manager that connects the processes of a distributed training run.

    It does nothing if there is one process.
    """
    if world.size == 1:
        yield
        return
    if device.startswith("cuda"):
        torch.cuda.set_device(world.device(device))
    torch.distributed.init_process_group("nccl" if device.startswith("cuda") else "gloo", timeout=_PATIENCE)
    try:
        yield
    finally:
        torch.distributed.destroy_process_group()


def _step_seed(seed: int, step: int, rank: int) -> int:
    digest = hashlib.sha256(f"betterbench training {seed} {step} {rank}".encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1
