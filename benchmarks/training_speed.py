"""Measure training on batches of demonstrations against the same network on random tensors in memory."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.errors import MissingDependencyError
from betterbench.json_form import file_digest
from betterbench.learning.training.data import TrainingSet, read_training_set
from betterbench.learning.training.frames import FrameStore
from betterbench.policies.learned import TrainingRecipe, read_training_recipe
from betterbench.policies.learned.loading import require_torch
from betterbench.records import JournalEntry, RunFolder
from betterbench.sim.scenes import renderer_fingerprint
from betterbench.sim.scenes.stage import QUALITIES
from figures import Figure, spread
from pacing import PICTURE_TASK, Rehearsal, rehearse

COPIES = 50
"""Number of copies of the demonstration; so many that the frames do not fit into the processor's caches."""

STEPS = 4
"""Number of training steps in a block; blocks on batches and blocks on random tensors alternate."""

_OF_FRAMES = ("tools", "poses", "actions", "phases", "at_gripper", "shown")
_OF_EPISODES = ("words", "sizes", "categories", "colors", "held_out")


def training_row(*, quick: bool) -> Iterator[Figure]:
    """Compare training steps on batches with the same number of steps on random tensors, for both families."""
    try:
        require_torch("this row")
    except MissingDependencyError as error:
        yield Figure("train", "training / the same on tensors in memory", (), "x", ">=", 0.9, str(error))
        return
    renderer_fingerprint()  # raises an error if nothing can be rendered
    with tempfile.TemporaryDirectory() as scratch:
        run = one_demonstration(Path(scratch) / "run", rehearse(PICTURE_TASK, QUALITIES["fast"]))
        for changes in ({}, {"family": "pixels", "eyes": {"quality": "fast"}}):
            recipe = read_training_recipe({"data": [str(run)], "validation": 0.0, **changes})
            frames = Path(scratch) / "frames"
            data = copied(read_training_set(recipe, frames=frames), frames, COPIES)
            yield training_figure(recipe, data, blocks=4 if quick else 10)


def training_figure(recipe: TrainingRecipe, data: TrainingSet, *, blocks: int) -> Figure:
    """Return the figure of a family from alternating blocks of steps; the first pair of blocks is not counted."""
    import torch  # noqa: PLC0415 - of the extra

    from betterbench.learning.training.batches import Batches  # noqa: PLC0415
    from betterbench.learning.training.data import scales_of  # noqa: PLC0415
    from betterbench.policies.learned.networks import new_network  # noqa: PLC0415

    torch.set_num_threads(1)
    batches, network = Batches(data, recipe, "cpu"), new_network(recipe, data.vocabulary)
    scales = scales_of(data)
    for name, buffer in network.named_buffers():
        buffer.copy_(torch.from_numpy(scales[name]))
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-4)

    def seconds(batch_of: Callable[[int], Any], first: int) -> float:
        began = time.process_time()
        for number in range(first, first + STEPS):
            loss = network(*batch_of(number))
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
        return time.process_time() - began

    shown, actions, counted = batches.sample(batches.drawn(0), training=True)
    numbers = {name: getattr(shown, name) for name in ("tools", "poses", "sizes", "pictures") if hasattr(shown, name)}
    random = {name: _random_like(values) for name, values in numbers.items()}
    in_memory = (replace(shown, **random), _random_like(actions), counted)
    own, bare = [], []
    for block in range(blocks):
        own.append(seconds(lambda n: batches.sample(batches.drawn(n), training=True), block * STEPS))
        bare.append(seconds(lambda _: in_memory, 0))
    rates = [[STEPS * recipe.batch / took for took in side[1:]] for side in (own, bare)]
    note = f"{spread(rates[0])} / {spread(rates[1])} samples per second of one core, batches of {recipe.batch}"
    text = f"training / the same on tensors in memory, {recipe.family}"
    return Figure("train", text, tuple(b / o for b, o in zip(bare[1:], own[1:], strict=True)), "x", ">=", 0.9, note)


def one_demonstration(folder: Path, rehearsal: Rehearsal) -> Path:
    """Write a run with the rehearsed episode, and return its folder."""
    record, scene = rehearsal.record, rehearsal.scene
    m = record.metadata
    trial = {"task": m.task, "condition": m.condition, "variation": None, "seed": m.seed}
    plan = {"trials": [trial], "policy": m.policy, "action_space": m.action_space, "quality": "fast"}
    run = RunFolder.start(folder, plan)
    digest = file_digest(run.write_record(record))
    run.store_scene(scene.content_hash, scene.files())
    with run.journal() as journal:
        journal.append(JournalEntry(m.task, m.condition, None, m.seed, record=digest))
    return run.path


def copied(data: TrainingSet, frames: Path, count: int) -> TrainingSet:
    """Return a training set with ``count`` copies of each demonstration and of the files of its frames."""
    steps, episodes = len(data.actions), len(data.trials)
    tiled: dict[str, Any] = {
        name: np.concatenate([getattr(data, name)] * count) for name in (*_OF_FRAMES, *_OF_EPISODES)
    }
    offsets = np.arange(count)[:, None]
    store = None
    if data.frames_of is not None:
        (file,) = frames.glob("*.bin")
        places = [frames / "copies" / f"{number}.bin" for number in range(count)]
        (frames / "copies").mkdir()
        store = FrameStore.open([Path(shutil.copyfile(file, place)) for place in places])
    return replace(
        data,
        **tiled,
        trials=data.trials * count,
        episodes=(data.episodes + episodes * offsets).reshape(-1),
        first=(data.first + steps * offsets).reshape(-1),
        last=(data.last + steps * offsets).reshape(-1),
        frames_of=store,
    )


def _random_like(values: Any) -> Any:  # noqa: ANN401 - a tensor, which only the extra has
    import torch  # noqa: PLC0415 - of the extra

    if values.dtype == torch.uint8:
        return torch.randint(0, 256, values.shape, dtype=torch.uint8)
    return torch.randn_like(values)
