"""A learner in a user's own file trains, resumes, acts and is refused as those that come with betterbench."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from asked import with_questions
from made_up import made_up, pictured
from small_recipes import tiny
from users_files import loader

from betterbench.cli.main import main
from betterbench.errors import BetterError, InvalidInputError
from betterbench.learning.study.learning import TrainingJob, train_learners
from betterbench.learning.training.batches import Batches
from betterbench.learning.training.loop import train
from betterbench.policies.kinds import needs_of
from betterbench.policies.learned.checkpoint import read_checkpoint
from betterbench.policies.learned.networks import new_network
from betterbench.policies.learned.policy import Learner
from betterbench.records import RunFolder
from betterbench.tasks import user_files

PAGE = Path(__file__).parents[3] / "docs" / "adding-a-learner.md"
(DEEP,) = re.findall(r"```py\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
"""The file that the documentation shows."""

SEEING = """
from torch import nn

from betterbench.policies.learned.families import learner
from betterbench.policies.learned.network import LearnerNetwork

@learner("normed", sees="pixels", parts=("eyes",))
class Normed(LearnerNetwork):
    def build(self, vocabulary):
        self.word = nn.EmbeddingBag(vocabulary.sizes()[0], self.recipe.size.width)
        self.eyes = nn.Sequential(nn.Conv2d(3, 8, 4, 4), nn.BatchNorm2d(8), nn.ReLU(), nn.Flatten())
        self.read = nn.Linear(8 * (self.recipe.eyes.size // 4) ** 2, self.recipe.size.width)

    def summary(self, shown, heard=None):
        pictures = shown.pictures[:, 0].permute(0, 3, 1, 2) / 255.0
        return self.read(self.eyes(pictures)) + self.word(shown.words)
"""
DEEP_RECIPE = {"family": "deep_sets"}
NORMED = {"family": "normed", "eyes": {"views": ["front"], "size": 16}}


class StoppedError(Exception):
    """Stands for whatever ends a process."""


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Loads a text as a user's file, in place of what this loaded before."""
    return functools.partial(loader(tmp_path, monkeypatch), anew=True)


def files(out: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file() and not p.name.endswith(".lock")}


@pytest.mark.parametrize("name", ["plain", "flow", "asked", "mean", "pictures"])
def test_its_training_resumes_to_the_same_bytes(load, tmp_path, monkeypatch, name):
    load(SEEING if name == "pictures" else DEEP)
    changes = {
        "plain": DEEP_RECIPE,
        "flow": {**DEEP_RECIPE, "loss": "flow", "history": 2},
        "asked": {**DEEP_RECIPE, "co_training": {"sets": ["questions"], "weight": 0.5}},
        "mean": {**DEEP_RECIPE, "options": {"pool": "mean"}},
        "pictures": NORMED,
    }[name]
    recipe = tiny(**changes)
    data = pictured(tmp_path / "frames") if recipe.sees == "pixels" else made_up()
    data = with_questions(data) if recipe.questions else data
    train(recipe, data, tmp_path / "whole")
    drawn = Batches.drawn

    def stopping(self, step, *rest):
        if step == 9:
            raise StoppedError
        return drawn(self, step, *rest)

    with monkeypatch.context() as patched:
        patched.setattr(Batches, "drawn", stopping)
        with pytest.raises(StoppedError):
            train(recipe, data, tmp_path / "parts")
    train(recipe, data, tmp_path / "parts")
    assert files(tmp_path / "parts") == files(tmp_path / "whole")
    (copy,) = (tmp_path / "whole" / "task_files").iterdir()
    assert copy.read_text(encoding="utf-8") == (SEEING if name == "pictures" else DEEP)


def test_the_learner_of_the_page_learns(load, tmp_path):
    """It goes to the object whose color is named, which nothing but words and colors tells."""
    load(DEEP)
    recipe = tiny(**DEEP_RECIPE, steps=500, batch=64, capacity={"width": 32, "layers": 1, "heads": 1}, ema=0.9)
    result = train(recipe, made_up(60), tmp_path / "out")
    assert result.log.losses[-1].loss < 0.5 * result.log.losses[0].loss
    (error,) = [e for e in result.log.errors if e.phase == "all" and e.step == recipe.steps]
    assert error.translation_mm < 8.0  # where one color is as good as the other it is some 30


def test_what_a_batch_norm_keeps_is_in_the_checkpoint(load, tmp_path):
    load(SEEING)
    result = train(tiny(**NORMED), pictured(tmp_path / "frames"), tmp_path / "out")
    network, _ = read_checkpoint(result.checkpoint)
    assert network.eyes[1].num_batches_tracked == 12
    assert network.eyes[1].running_mean.abs().max() > 0.0


def test_weights_are_used_with_the_code_that_they_were_trained_with(load, tmp_path):
    load(DEEP)
    result = train(tiny(**DEEP_RECIPE), made_up(), tmp_path / "out")
    network, trained = read_checkpoint(result.checkpoint)
    assert trained.code == f"sha256 {user_files.TaskFile.read(tmp_path / 'mine.py').sha256}"
    load(DEEP.replace("amax(1)", "amin(1)"))
    with pytest.raises(InvalidInputError, match=r"was defined by sha256 .*task_files"):
        read_checkpoint(result.checkpoint)
    with pytest.raises(BetterError, match=r"different training: .*learner.*Continue with the learner's original file"):
        train(tiny(**DEEP_RECIPE), made_up(), tmp_path / "out")
    load("")
    with pytest.raises(InvalidInputError, match=r"Unknown family 'deep_sets'.*--task-file"):
        read_checkpoint(result.checkpoint)
    assert needs_of(f"learned:{tmp_path / 'out'}").state
    (copy,) = (tmp_path / "out" / "task_files").iterdir()
    load(copy.read_text(encoding="utf-8"), name="again.py")
    again, _ = read_checkpoint(result.checkpoint)
    assert all(torch.equal(one, other) for one, other in zip(network.parameters(), again.parameters(), strict=True))


def test_frozen_parts_of_its_own_stay_as_they_were(load, tmp_path):
    load(DEEP)
    train(tiny(**DEEP_RECIPE), made_up(), tmp_path / "first")
    recipe = tiny(**DEEP_RECIPE, start=str(tmp_path / "first"), frozen=["each"], seed=1)
    result = train(recipe, made_up(), tmp_path / "second")
    (first, _), (second, _) = (read_checkpoint(tmp_path / n / "checkpoint.safetensors") for n in ("first", "second"))
    moved = {n for n, p in second.named_parameters() if not torch.equal(p, dict(first.named_parameters())[n])}
    assert moved
    assert not any(name.startswith("each.") for name in moved)
    assert result.parameters == sum(p.numel() for n, p in second.named_parameters() if not n.startswith("each."))


COUNTING = """
import math

import torch
from torch import nn

from betterbench.policies.learned.families import learner
from betterbench.policies.learned.network import LearnerNetwork

@learner("counting", sees="objects", parts=("normed", "word"))
class Counting(LearnerNetwork):
    def build(self, vocabulary):
        width = self.recipe.size.width
        self.word = nn.EmbeddingBag(vocabulary.sizes()[0], width)
        self.normed = nn.Sequential(nn.Linear(10, width), nn.BatchNorm1d(width))
        self.fixed = nn.Linear(width, width).requires_grad_(False)
        self.register_buffer("mask", torch.full((2, 2), -math.inf))
        self.register_buffer("count", torch.zeros(()))

    def summary(self, shown, heard=None):
        if self.training:
            self.count = self.count + 1
        found = self.normed(shown.tools[:, 0]) + self.word(shown.words)
        return found + self.fixed(found) + 0.1 * torch.rand_like(found)
"""


def test_what_its_author_keeps_beside_the_weights_is_kept(load, tmp_path):
    """An infinite mask, a buffer that is assigned anew, a module that build has frozen, random numbers of its own."""
    load(COUNTING)
    result = train(tiny(family="counting"), made_up(), tmp_path / "out")
    network, trained = read_checkpoint(result.checkpoint)
    assert network.count == 12
    torch.manual_seed(0)
    start = new_network(trained.recipe, trained.vocabulary)
    assert torch.equal(network.fixed.weight, start.fixed.weight)
    learner, other = Learner(network, trained), Learner(read_checkpoint(result.checkpoint)[0], trained)
    shown, _, _ = Batches(made_up(), trained.recipe, "cpu").sample(np.array([3]), training=False)
    assert np.array_equal(learner.chunk(shown, 5), other.chunk(shown, 5))
    assert not np.array_equal(learner.chunk(shown, 5), learner.chunk(shown, 6))


def test_a_frozen_batch_norm_of_its_own_stays_as_it_was(load, tmp_path):
    load(COUNTING)
    train(tiny(family="counting"), made_up(), tmp_path / "first")
    recipe = tiny(family="counting", start=str(tmp_path / "first"), frozen=["normed"])
    train(recipe, made_up(), tmp_path / "second")
    one, other = (read_checkpoint(tmp_path / n / "checkpoint.safetensors")[0].normed for n in ("first", "second"))
    assert all(torch.equal(a, b) for a, b in zip(one.state_dict().values(), other.state_dict().values(), strict=True))


def test_a_start_of_other_code_is_refused(load, tmp_path):
    load(DEEP)
    train(tiny(**DEEP_RECIPE), made_up(), tmp_path / "first")
    load(DEEP.replace("amax(1)", "amin(1)"))
    with pytest.raises(InvalidInputError, match=r"start: .*was defined by"):
        train(tiny(**DEEP_RECIPE, start=str(tmp_path / "first")), made_up(), tmp_path / "second")


LAST = "        return self.last(pooled)\n"
WRONG = {
    "shape": (LAST, "        return self.last(pooled)[:, :3]\n", r"summary returns \(8, 3\), expected .*\(8, 16\)"),
    "nothing": (LAST, "        self.last(pooled)\n", "summary returns NoneType"),
    "raises": (LAST, "        return self.lost(pooled)\n", r"mine.py, line \d+: .*no attribute 'lost'"),
    "unused": (LAST, "        return pooled\n", "the loss does not depend on the weights last.0.weight"),
    "no summary": ("def summary", "def sumary", "mine.py: NotImplementedError: DeepSets must implement summary"),
    "no build": ("def build", "def bild", "mine.py: NotImplementedError: DeepSets must implement build"),
    "no network": ("(LearnerNetwork)", "", "TypeError|got DeepSets"),
    "twice": (
        "DeepSets(",
        "DeepSets(LearnerNetwork): pass\n\n@learner('deep_sets', sees='objects')\nclass Again(",
        "twice",
    ),
    "late": (LAST, "        self.late = torch.nn.Linear(16, 16)\n" + LAST, "late.bias was created after build"),
    "tied": (
        "self.keep_scale(",
        "self.tied = self.word\n        self.keep_scale(",
        "word.weight and tied.weight are the same",
    ),
    "taken": ("self.last = ", "self.head = self.last = ", "the module name 'head' is reserved"),
    "double": (LAST, "        return self.last(pooled).double()\n", "returns torch.float64, expected torch.float32"),
    "loss": (
        LAST,
        LAST + "\n    def loss(self, shown, actions, counted):\n        return 1.0\n",
        "its loss is not a scalar",
    ),
    "in loss": (
        LAST,
        LAST + "\n    def loss(self, shown, actions, counted):\n        return 1 / 0\n",
        r"line \d+: ZeroDiv",
    ),
    "answer": (
        LAST,
        LAST + "\n    def answer(self, *given):\n        return super().answer(*given)[:, :1]\n",
        r"\(batch, chunk, 7\)",
    ),
    "sparse": ("nn.Embedding(words, width)", "nn.Embedding(words, width, sparse=True)", "of word.weight is sparse"),
    "lazy": ("self.last = ", "self.lazy = torch.nn.LazyLinear(3)\n        self.last = ", "lazy.weight is unknown"),
    "extra": (LAST, LAST + "\n    def get_extra_state(self):\n        return {}\n", "not a tensor"),
    "scale": ('"position", 3', '"position", 4', r"no scale 'position' of 4 numbers.*\(\"position\", 3\)"),
    "name of scale": ('"position", 3', '"tools", 3', "no scale 'tools' of 3"),
    "in build": ("self.word = ", "self.word = 1 / 0 or ", r"mine.py, line \d+: ZeroDivisionError"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_learner_that_is_wrong_is_one_line_that_says_where(load, tmp_path, name):
    old, new, said = WRONG[name]
    assert old in DEEP

    def trained():
        load(DEEP.replace(old, new, 1))
        train(tiny(**DEEP_RECIPE), made_up(), tmp_path / "out")

    with pytest.raises(InvalidInputError, match=said) as error:
        trained()
    assert "\n" not in str(error.value)


def test_a_part_that_its_network_does_not_have(load, tmp_path):
    load(DEEP.replace('parts=("each",)', 'parts=("every",)'))
    train(tiny(**DEEP_RECIPE), made_up(), tmp_path / "first")
    with pytest.raises(InvalidInputError, match="no part 'every'"):
        train(tiny(**DEEP_RECIPE, start=str(tmp_path / "first"), frozen=["every"]), made_up(), tmp_path / "out")


def test_it_is_evaluated_by_workers(load, tmp_path):
    load(DEEP)
    train(tiny(**DEEP_RECIPE), made_up(), tmp_path / "learner")
    words = ["eval", "--policy", f"learned:{tmp_path / 'learner'}", "--tasks", "morning_coffee", "--trials", "1"]
    words += ["--task-file", str(tmp_path / "mine.py"), "--workers", "2", "--out", str(tmp_path / "run")]
    assert main(words) == 0
    entries = RunFolder.open(tmp_path / "run").entries()
    assert {entry.status for entry in entries} == {"done"}


def test_learners_that_are_trained_side_by_side_get_the_same_text(load, tmp_path, monkeypatch):
    """Also where the file has changed since: the processes get what was loaded."""
    load(DEEP)
    monkeypatch.delenv(user_files.VARIABLE)
    (tmp_path / "mine.py").write_text("raise ValueError", encoding="utf-8")
    jobs = [TrainingJob(tiny(**DEEP_RECIPE, seed=seed, data=["nowhere"]), tmp_path / str(seed)) for seed in (0, 1)]
    with pytest.raises(BetterError, match="contains no demonstrations"):
        train_learners(jobs, "cpu", lambda *_: None)


def test_the_tables_name_each_field_that_is_shown():
    text = PAGE.read_text(encoding="utf-8")
    for name in ("words", "tools", "blind", "poses", "sizes", "categories", "colors", "pictures", "light"):
        assert f"`{name}`" in text
    assert np.all([f"`{name}`" in text for name in ("sees", "capacities", "parts", "options")])


def test_the_command_ends_with_how_it_is_evaluated(load, tmp_path, monkeypatch, capsys):
    load(DEEP)
    monkeypatch.setattr("betterbench.learning.training.data.read_training_set", lambda *_, **__: made_up())
    words = ["capacity: {width: 16, layers: 1, heads: 1}", "family: deep_sets", "data: [x]", "steps: 2", "rollouts: 0"]
    (tmp_path / "recipe.yaml").write_text("\n".join(words), encoding="utf-8")
    file = str(tmp_path / "mine.py")
    assert main(["train", str(tmp_path / "recipe.yaml"), "--task-file", file, "--out", str(tmp_path / "out")]) == 0
    assert f"learned:{tmp_path / 'out'} --task-file {file}" in capsys.readouterr().out
