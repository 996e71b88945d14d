"""Training: resumed is undisturbed, wrong input is one line, and what is learned can be told."""

from __future__ import annotations

import dataclasses
import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from asked import with_questions
from made_up import made_up, pictured
from small_recipes import PIXELS, tiny
from torch.nn import functional

from betterbench.errors import BetterError, InvalidInputError, RunConflictError, StorageError, TrainingError
from betterbench.jobs import durable
from betterbench.learning.training.batches import Batches
from betterbench.learning.training.loop import STATE_NAME, train
from betterbench.policies.learned.checkpoint import (
    Trained,
    read_checkpoint,
    read_tensors,
    write_checkpoint,
    write_tensors,
)
from betterbench.policies.learned.network import ObjectsNetwork
from betterbench.policies.learned.networks import new_network
from betterbench.policies.learned.pixels import channels_of, key_points

FILES = (
    "checkpoint.safetensors",
    STATE_NAME,
    "loss.csv",
    "validation.csv",
    "rollouts.csv",
    "curves.svg",
    "recipe.json",
)


ASKED = {"sets": ["questions"], "weight": 0.5}


class StoppedError(Exception):
    """Stands for whatever ends a process."""


def contents(out: Path) -> dict[str, bytes]:
    return {name: (out / name).read_bytes() for name in FILES}


def stop_at(monkeypatch, step: int) -> None:
    before = Batches.drawn

    def drawn(self, asked, *rest):
        if asked == step:
            raise StoppedError
        return before(self, asked, *rest)

    monkeypatch.setattr(Batches, "drawn", drawn)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"loss": "flow", "dropout": 0.1, "proprioception": {"noise_m": 0.01, "dropout": 0.5}},
        {**PIXELS, "augmentation": {"light": 0.1}, "history": 2, "proprioception": {"noise_m": 0.01, "dropout": 0.5}},
        {"co_training": ASKED, "proprioception": {"noise_m": 0.01}},
        {**PIXELS, "co_training": ASKED},
    ],
)
def test_resumed_is_undisturbed(tmp_path, monkeypatch, changes):
    recipe = tiny(**changes)
    data = pictured(tmp_path / "frames") if recipe.family == "pixels" else made_up()
    data = with_questions(data) if recipe.questions else data
    train(recipe, data, tmp_path / "whole")
    for step in (3, 5, 10):
        with monkeypatch.context() as patched:
            stop_at(patched, step)
            with pytest.raises(StoppedError):
                train(recipe, data, tmp_path / "parts")
    train(recipe, data, tmp_path / "parts")
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")


def test_another_seed_gives_other_weights(tmp_path):
    for seed in (0, 1):
        train(tiny(seed=seed), made_up(), tmp_path / str(seed))
    one, other = ((tmp_path / str(s) / FILES[0]).read_bytes() for s in (0, 1))
    assert one != other


def test_a_complete_training_is_left_as_it_is(tmp_path):
    recipe, data = tiny(), made_up()
    train(recipe, data, tmp_path / "out")
    before = contents(tmp_path / "out")
    assert train(recipe, data, tmp_path / "out").samples_per_s == 0.0
    assert contents(tmp_path / "out") == before


@pytest.mark.parametrize("other", [{"seed": 3}, {"steps": 13}])
def test_another_recipe_does_not_go_on_in_the_folder(tmp_path, other):
    train(tiny(), made_up(), tmp_path / "out")
    with pytest.raises(RunConflictError, match=next(iter(other))):
        train(tiny(**other), made_up(), tmp_path / "out")
    with pytest.raises(RunConflictError, match="data"):
        train(tiny(), made_up(seed=1), tmp_path / "out")


@pytest.mark.parametrize("starts", [False, True])
def test_a_training_whose_data_were_moved_goes_on(tmp_path, monkeypatch, starts):
    data = made_up() if starts else with_questions(made_up())

    def recipe(place: Path):
        if starts:
            return tiny(data=[str(place)], start=str(place / "first"))
        return tiny(data=[str(place)], co_training={**ASKED, "sets": [str(place / "questions")]})

    old, new = tmp_path / "old", tmp_path / "new"
    train(tiny(), made_up(), old / "first")
    with monkeypatch.context() as patched:
        stop_at(patched, 5)
        with pytest.raises(StoppedError):
            train(recipe(old), data, old / "out")
    old.rename(new)
    train(recipe(new), data, new / "out")
    train(recipe(new), data, tmp_path / "whole")
    assert contents(new / "out") == contents(tmp_path / "whole")


def test_a_folder_with_other_files_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(RunConflictError, match="other files"):
        train(tiny(), made_up(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_loss_that_is_not_finite_keeps_what_was_saved(tmp_path, monkeypatch):
    recipe, data, before = tiny(), made_up(), ObjectsNetwork.loss
    calls = []

    def loss(self, *given):
        calls.append(1)
        return before(self, *given) * (float("nan") if len(calls) > 6 else 1.0)

    with monkeypatch.context() as patched:
        patched.setattr(ObjectsNetwork, "loss", loss)
        with pytest.raises(TrainingError, match="step 7: the loss is nan"):
            train(recipe, data, tmp_path / "out")
    train(recipe, data, tmp_path / "out")
    train(recipe, data, tmp_path / "whole")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_a_full_disk_keeps_what_was_saved(tmp_path, monkeypatch):
    recipe, data, before = tiny(), made_up(), durable.DurableFile.finish
    calls = []

    def finish(self):
        calls.append(1)
        if len(calls) > 8:
            raise OSError(errno.ENOSPC, "No space left on device")
        before(self)

    with monkeypatch.context() as patched:
        patched.setattr(durable.DurableFile, "finish", finish)
        with pytest.raises(StorageError, match="free disk space"):
            train(recipe, data, tmp_path / "out")
    assert (tmp_path / "out" / STATE_NAME).exists()
    train(recipe, data, tmp_path / "out")
    train(recipe, data, tmp_path / "whole")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_what_a_killed_process_left_half_written_is_removed(tmp_path):
    train(tiny(), made_up(), tmp_path / "out")
    part = tmp_path / "out" / f".{STATE_NAME}.abc.part"
    part.write_bytes(b"half")
    train(tiny(), made_up(), tmp_path / "out")
    assert not part.exists()


def test_weights_that_are_not_finite_are_refused(tmp_path):
    network, path = ObjectsNetwork(tiny(), made_up().vocabulary), tmp_path / "checkpoint.safetensors"
    with torch.no_grad():
        network.readout[0] = float("nan")
    write_checkpoint(path, network.state_dict(), Trained(tiny(), made_up().vocabulary, 1, "none"))
    with pytest.raises(InvalidInputError, match="not finite"):
        read_checkpoint(path)


def test_another_start_does_not_go_on_in_the_folder(tmp_path):
    data, recipe = made_up(), tiny(start=str(tmp_path / "first"))
    with pytest.raises(InvalidInputError, match="contains no checkpoint"):
        train(recipe, data, tmp_path / "second")
    train(tiny(), data, tmp_path / "first")
    train(recipe, data, tmp_path / "second")
    train(tiny(seed=1), data, tmp_path / "other")
    (tmp_path / "other" / FILES[0]).replace(tmp_path / "first" / FILES[0])
    with pytest.raises(RunConflictError, match="start"):
        train(recipe, data, tmp_path / "second")


@pytest.mark.parametrize("harm", ["cut", "flipped", "empty", "text"])
def test_a_damaged_file_is_one_line(tmp_path, harm):
    train(tiny(), made_up(), tmp_path / "out")
    for name in (STATE_NAME, "checkpoint.safetensors"):
        path = tmp_path / "out" / name
        good = path.read_bytes()
        flipped = bytearray(good)
        flipped[-9] ^= 64
        path.write_bytes({"cut": good[:-40], "flipped": bytes(flipped), "empty": b"", "text": b"weights " * 99}[harm])
    with pytest.raises(InvalidInputError, match="damaged"):
        read_checkpoint(tmp_path / "out" / "checkpoint.safetensors")
    with pytest.raises(InvalidInputError, match="damaged"):
        train(tiny(), made_up(), tmp_path / "out")


def test_the_state_of_another_training_is_refused(tmp_path):
    """Also one whose tensors have the same names and shapes, and a checkpoint in its place."""
    for seed in (0, 1):
        train(tiny(seed=seed), made_up(), tmp_path / str(seed))
    before = contents(tmp_path / "0")
    for other in (tmp_path / "1" / STATE_NAME, tmp_path / "0" / "checkpoint.safetensors"):
        (tmp_path / "0" / STATE_NAME).write_bytes(other.read_bytes())
        with pytest.raises(InvalidInputError, match=r"state.safetensors.*another training.*restore the file"):
            train(tiny(), made_up(), tmp_path / "0")
    (tmp_path / "0" / STATE_NAME).write_bytes(before[STATE_NAME])
    train(tiny(), made_up(), tmp_path / "0")
    assert contents(tmp_path / "0") == before


@pytest.mark.parametrize(
    "forge",
    [
        lambda state: state[1].update(step="4"),
        lambda state: state[1].update(step=13),
        lambda state: state[1].update(rows=[[0.5]]),
        lambda state: state[1].pop("rows"),
        lambda state: state[0].pop(next(n for n in state[0] if n.startswith("first/"))),
        lambda state: state[0].pop(next(n for n in state[0] if n.startswith("mean/"))),
        lambda state: state[0].update({n: t.reshape(-1) for n, t in state[0].items() if n.startswith("second/")}),
    ],
)
def test_a_state_of_a_stranger_is_refused_in_one_line(tmp_path, forge):
    """It is sealed as it should be, and says it is of this training."""
    train(tiny(), made_up(), tmp_path / "out")
    state = read_tensors(tmp_path / "out" / STATE_NAME)
    forge(state)
    write_tensors(tmp_path / "out" / STATE_NAME, *state)
    with pytest.raises(InvalidInputError, match=STATE_NAME) as caught:
        train(tiny(), made_up(), tmp_path / "out")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["loss.csv", "validation.csv"])
def test_a_table_is_what_was_written_with_the_state(tmp_path, name):
    train(tiny(), made_up(), tmp_path / "out")
    table = tmp_path / "out" / name
    head, first, *rest = table.read_text().splitlines()
    table.write_text("\n".join([head, first.replace(".", ".1", 1), *rest]) + "\n")
    with pytest.raises(InvalidInputError, match="tables of the training do not match the saved state"):
        train(tiny(), made_up(), tmp_path / "out")


@pytest.mark.parametrize("harm", ["missing", "text", "long"])
def test_a_damaged_table_is_no_reason_to_remove_the_weights(tmp_path, harm):
    train(tiny(), made_up(), tmp_path / "out")
    table = tmp_path / "out" / "loss.csv"
    if harm == "missing":
        table.unlink()
    else:
        table.write_text({"text": "step\nx\n", "long": "step\n" + "9" * 200_000}[harm])
    with pytest.raises(BetterError, match=r"loss\.csv: the table cannot be read .*are kept") as caught:
        train(tiny(), made_up(), tmp_path / "out")
    assert "remove" not in str(caught.value)


TOGETHER = """
import dataclasses, sys
from pathlib import Path
from made_up import made_up
from small_recipes import tiny
from betterbench.learning.training.batches import Batches
from betterbench.learning.training.loop import train

out, stop, changes = Path(sys.argv[1]), int(sys.argv[2]), eval(sys.argv[3])
before = Batches.drawn

def drawn(self, step, *rest):
    if step == stop:
        raise SystemExit(3)
    return before(self, step, *rest)

Batches.drawn = drawn
train(tiny(**changes), made_up(), out)
"""


def together(tmp_path, out, *, stop=-1, **changes):
    """Trains in two processes that torch's launcher starts."""
    script = tmp_path / "together.py"
    script.write_text(TOGETHER)
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    path = os.pathsep.join(dict.fromkeys(p for p in sys.path if p))
    return subprocess.run(
        [*launcher, script, out, str(stop), repr(changes)],
        check=False, capture_output=True, text=True, timeout=300, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip


def weights(out):
    return read_checkpoint(out / "checkpoint.safetensors")[0].state_dict()


def test_two_processes_train_as_one_and_resume(tmp_path):
    changes = {"augmentation": {}, "proprioception": {}}
    assert together(tmp_path, tmp_path / "whole", **changes).returncode == 0
    assert together(tmp_path, tmp_path / "parts", stop=9, **changes).returncode != 0
    assert together(tmp_path, tmp_path / "parts", **changes).returncode == 0
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")
    train(tiny(**changes), made_up(), tmp_path / "alone")
    torch.manual_seed(tiny().seed)
    start = new_network(tiny(**changes), made_up().vocabulary).state_dict()
    both, alone = (weights(tmp_path / name) for name in ("whole", "alone"))
    way = max(float((start[name] - alone[name]).abs().max()) for name in alone)
    assert max(float((both[name] - alone[name]).abs().max()) for name in alone) < 0.05 * way
    with pytest.raises(
        RunConflictError,
        match=r"processes is 2 in the folder but 1 in the request. Continue with the same number of processes,",
    ):
        train(tiny(**changes), made_up(), tmp_path / "whole")


@pytest.mark.parametrize("step", [-1, 1.5, "x", True])
def test_a_number_of_steps_that_is_none_is_refused(tmp_path, step):
    data = made_up()
    network, path = ObjectsNetwork(tiny(), data.vocabulary), tmp_path / "checkpoint.safetensors"
    write_checkpoint(path, network.state_dict(), Trained(tiny(), data.vocabulary, step, "none"))
    with pytest.raises(InvalidInputError, match="as the number of training steps"):
        read_checkpoint(path)


def test_draws_follow_from_the_step_alone_and_are_shared_out():
    batches = Batches(made_up(), tiny(), "cpu")
    whole = batches.drawn(5)
    assert np.array_equal(whole, batches.drawn(5))
    assert not np.array_equal(whole, batches.drawn(6))
    shared = np.empty_like(whole)
    for rank in range(2):
        shared[rank::2] = batches.drawn(5, rank, 2)
    assert np.array_equal(shared, whole)


@pytest.mark.parametrize("changes", [{}, PIXELS])
def test_questions_show_what_is_asked_about_and_never_what_is_held_out(tmp_path, changes):
    data = with_questions(pictured(tmp_path / "frames") if changes else made_up())
    recipe = tiny(**changes, batch=4096, co_training=ASKED)
    batches = Batches(data, recipe, "cpu")
    chosen = batches.drawn_questions(0)
    assert len(chosen) == recipe.questions == 2048
    assert not data.held_out[data.questions.episodes[chosen]].any()
    halves = [batches.drawn_questions(0, rank, 2) for rank in range(2)]
    assert np.array_equal(np.stack(halves, axis=1).reshape(-1), chosen)
    assert not np.array_equal(batches.drawn_questions(1), chosen)
    asked = batches.questions(chosen[:3], training=False)
    assert np.array_equal(asked.answers, data.questions.answers[chosen[:3]])
    assert np.array_equal(asked.shown.words, data.questions.words[chosen[:3]])
    if changes:
        assert np.array_equal(asked.shown.pictures, data.frames_of.read(5 * chosen[:3]))
    else:
        assert np.array_equal(asked.shown.poses, data.questions.poses[chosen[:3]])
        assert np.array_equal(asked.shown.colors, data.colors[data.questions.episodes[chosen[:3]]])


def test_each_question_counts_as_much_as_each_frame():
    data = with_questions(made_up())
    recipe = tiny(co_training=ASKED)
    torch.manual_seed(0)
    network, batches = new_network(recipe, data.vocabulary), Batches(data, recipe, "cpu")
    shown, actions, counted = batches.sample(np.arange(8), training=False)
    asked = batches.questions(np.arange(4), training=False)
    alone = functional.cross_entropy(network.reply(asked.shown), asked.answers)
    both = network(shown, actions, counted, asked)
    assert torch.allclose(both, network(shown, actions, counted) + 0.5 * alone)


def test_what_is_asked_does_not_change_which_frames_are_drawn():
    with_them = Batches(with_questions(made_up()), tiny(co_training=ASKED), "cpu")
    assert np.array_equal(with_them.drawn(3), Batches(made_up(), tiny(), "cpu").drawn(3))


def test_a_learner_learns_to_answer(tmp_path):
    recipe = tiny(
        steps=400, batch=32, learning_rate=3e-3, ema=0.9, capacity={"width": 32, "layers": 2, "heads": 4},
        validate_every=400, save_every=400, co_training=ASKED,
    )  # fmt: skip
    result = train(recipe, with_questions(made_up(120)), tmp_path / "out")
    (rate, overall) = result.log.answers
    assert (rate.type, overall.type) == ("relation", "all")
    assert overall.right == overall.asked == 8
    assert (tmp_path / "out" / "answers.csv").read_text().splitlines()[1] == "400,relation,8,8"
    network, trained = read_checkpoint(result.checkpoint)
    assert trained.vocabulary.answers == ("left", "right")
    assert "answers.weight" in network.state_dict()


def test_held_out_demonstrations_are_never_drawn():
    data = made_up()
    batches = Batches(data, tiny(batch=4096), "cpu")
    assert not data.held_out[data.episodes[batches.drawn(0)]].any()


def test_chunks_end_and_histories_begin_with_the_demonstration():
    data, recipe = made_up(), tiny(history=3, history_stride=2)
    shown, actions, counted = Batches(data, recipe, "cpu").sample(np.array([19, 21]), training=False)
    assert counted.tolist() == [[True, False, False, False], [True] * 4]
    assert np.array_equal(actions[0], np.repeat(data.actions[19:20], 4, axis=0))
    assert np.array_equal(shown.tools[0], data.tools[[19, 17, 15]])
    assert np.array_equal(shown.tools[1], data.tools[[21, 20, 20]])


def test_the_order_of_objects_means_nothing():
    data = made_up()
    torch.manual_seed(0)
    network = ObjectsNetwork(tiny(), data.vocabulary).eval()
    shown, _, _ = Batches(data, tiny(), "cpu").sample(np.arange(8), training=False)
    turned = dataclasses.replace(
        shown, **{name: getattr(shown, name).flip(1) for name in ("poses", "sizes", "categories", "colors")}
    )
    with torch.inference_mode():
        torch.testing.assert_close(network.answer(shown), network.answer(turned), atol=1e-5, rtol=1e-5)


def test_without_proprioception_the_tool_changes_nothing():
    data, recipe = made_up(), tiny(proprioception={"given": False})
    network = ObjectsNetwork(recipe, data.vocabulary).eval()
    shown, _, _ = Batches(data, recipe, "cpu").sample(np.arange(8), training=False)
    moved = dataclasses.replace(shown, tools=shown.tools + 1.0)
    with torch.inference_mode():
        assert torch.equal(network.answer(shown), network.answer(moved))


def test_frozen_parts_stay_as_they_began(tmp_path):
    data = made_up()
    train(tiny(), data, tmp_path / "first")
    recipe = tiny(start=str(tmp_path / "first"), frozen=["words", "trunk"], ema=0.0)
    train(recipe, data, tmp_path / "second")
    (before, _), (after, _) = (read_checkpoint(tmp_path / f / "checkpoint.safetensors") for f in ("first", "second"))
    for part, parameters in after.parts().items():
        same = all(torch.equal(a, b) for a, b in zip(parameters, before.parts()[part], strict=True))
        assert same == (part in recipe.frozen), part


@pytest.fixture
def seen(tmp_path):
    """Training set, recipe and network of a learner of pixels, and a batch without augmentation."""

    def make(**changes):
        data, recipe = pictured(tmp_path / "frames"), tiny(**PIXELS, **changes)
        torch.manual_seed(0)
        network, batches = new_network(recipe, data.vocabulary).eval(), Batches(data, recipe, "cpu")
        return data, network, batches.sample(np.array([0, 25, 47]), training=False)[0], batches

    return make


def test_pictures_of_a_batch_are_those_of_its_frames(seen):
    data, _, shown, batches = seen()
    assert np.array_equal(shown.pictures.numpy(), data.frames_of.read(np.array([0, 25, 47])))
    torch.manual_seed(3)
    moved = batches.sample(np.array([0, 25, 47]), training=True)[0].pictures
    assert moved.shape == shown.pictures.shape
    assert not torch.equal(moved, shown.pictures)


def test_frames_that_are_not_shown_are_never_drawn(tmp_path):
    whole = pictured(tmp_path / "frames")
    shown = np.arange(len(whole.actions)) % 2 == 0
    data = dataclasses.replace(whole, shown=shown)
    batches = Batches(data, tiny(**PIXELS, batch=512), "cpu")
    assert shown[batches.drawn(0)].all()
    found = batches.sample(np.array([0, 46]), training=False)[0].pictures.numpy()
    assert np.array_equal(found, whole.frames_of.read(np.array([0, 23])))


@pytest.mark.parametrize("what", ["words", "pictures", "tools", "light"])
def test_everything_that_is_shown_matters(seen, what):
    _, network, shown, _ = seen()
    other = {
        "words": 5 - shown.words,
        "pictures": 255 - shown.pictures,
        "tools": shown.tools + 1.0,
        "light": torch.full((3, 2), 0.3),
    }
    changed = dataclasses.replace(shown, **{what: other[what]})
    with torch.inference_mode():
        assert not torch.allclose(network.answer(shown), network.answer(changed))


@pytest.mark.parametrize("changes", [{}, {"proprioception": {"given": False}}])
def test_what_is_left_out_changes_nothing(seen, changes):
    _, network, shown, _ = seen(**changes)
    moved = dataclasses.replace(shown, tools=shown.tools + 1.0)
    with torch.inference_mode():
        assert torch.equal(network.answer(shown), network.answer(moved)) == bool(changes)


def test_a_key_point_is_where_its_channel_peaks():
    seen = torch.zeros(2, 4, 5, 9)
    seen[0, 1, 4, 2] = seen[1, 3, 0, 8] = 50.0
    found = key_points(seen).view(2, 3, 4)
    assert found[0, :, 1].tolist() == pytest.approx([-0.5, 1.0, 50.0], abs=1e-5)
    assert found[1, :, 3].tolist() == pytest.approx([1.0, -1.0, 50.0], abs=1e-5)
    assert found[0, :, 0].tolist() == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(("capacity", "family"), [(c, f) for c in ("small", "base") for f in ("objects", "pixels")])
def test_weights_take_at_most_4_mb(capacity, family):
    network = new_network(tiny(family=family, capacity=capacity, chunk=8), made_up().vocabulary)
    assert 4 * sum(p.numel() for p in network.parameters()) < 4e6
    assert channels_of(96) == (16, 32, 64, 96)


def test_frozen_eyes_stay_as_they_began(tmp_path):
    data = pictured(tmp_path / "frames")
    train(tiny(**PIXELS), data, tmp_path / "first")
    recipe = tiny(**PIXELS, start=str(tmp_path / "first"), frozen=["eyes"], ema=0.0)
    train(recipe, data, tmp_path / "second")
    (before, _), (after, _) = (read_checkpoint(tmp_path / f / "checkpoint.safetensors") for f in ("first", "second"))
    for part, parameters in after.parts().items():
        same = all(torch.equal(a, b) for a, b in zip(parameters, before.parts()[part], strict=True))
        assert same == (part == "eyes"), part


def test_a_start_of_another_family_is_one_line(tmp_path):
    train(tiny(), made_up(), tmp_path / "first")
    recipe = tiny(**PIXELS, start=str(tmp_path / "first"))
    with pytest.raises(InvalidInputError, match="do not match its recipe") as caught:
        train(recipe, pictured(tmp_path / "frames"), tmp_path / "second")
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_the_word_decides_where_a_learner_of_pixels_goes(tmp_path):
    data = pictured(tmp_path / "frames", 200, size=24)
    recipe = tiny(
        **{**PIXELS, "eyes": {"views": ["front"], "size": 24}}, augmentation={"shift_px": 0}, steps=1500, batch=64,
        learning_rate=3e-3, ema=0.99, capacity={"width": 48, "layers": 2, "heads": 4}, validate_every=1500,
        save_every=1500,
    )  # fmt: skip
    log = train(recipe, data, tmp_path / "out").log
    overall = next(row for row in log.errors if row.phase == "all")
    typical = 50.0 * np.linalg.norm(data.actions[:, :3], axis=1).mean()
    assert overall.translation_mm < 0.5 * typical


@pytest.mark.slow
@pytest.mark.parametrize(("loss", "share"), [("l1", 0.25), ("flow", 0.5)])  # of a flow, one draw is compared
def test_the_word_decides_where_the_tool_goes(tmp_path, loss, share):
    recipe = tiny(
        loss=loss, steps=1500, batch=64, learning_rate=3e-3, ema=0.99, capacity={"width": 32, "layers": 2, "heads": 4},
        validate_every=1500, save_every=1500,
    )  # fmt: skip
    log = train(recipe, made_up(200), tmp_path / "out").log
    overall = next(row for row in log.errors if row.phase == "all")
    typical = 50.0 * np.linalg.norm(made_up(200).actions[:, :3], axis=1).mean()
    assert overall.translation_mm < share * typical
    assert overall.gripper_wrong < 0.05
