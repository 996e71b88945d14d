"""A co-trained learner is asked about its own trials, with what it sees when it acts there."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from asked import asked_set, question
from demonstrating import add_record, start_run
from short_records import TRIALS, short_records
from small_recipes import PIXELS, tiny

from betterbench.cli.main import main
from betterbench.diagnosis import diagnose_run
from betterbench.errors import InvalidInputError
from betterbench.evaluation import evaluate, make_plan
from betterbench.evaluation.figures.views import ViewRenderer
from betterbench.learning.training import answering
from betterbench.learning.training import own_answers as module
from betterbench.learning.training.answering import LearnerModel
from betterbench.learning.training.batches import Batches
from betterbench.learning.training.data import read_training_set
from betterbench.learning.training.own_answers import ask_about_run, own_answers, summaries_of
from betterbench.learning.training.questions import learned_class, option_class
from betterbench.policies.kinds import read_address
from betterbench.policies.learned.checkpoint import Trained, write_checkpoint
from betterbench.policies.learned.loading import load_learner
from betterbench.policies.learned.networks import new_network
from betterbench.policies.learned.policy import Learner
from betterbench.policies.learned.vocabulary import Vocabulary
from betterbench.vqa import Form
from betterbench.vqa.asking import prompt_for
from betterbench.vqa.blind import answer_class
from betterbench.vqa.decisive import TIMES_ASKED, DecisiveOptions, make_decisive_set
from betterbench.vqa.llm import RefusedError
from betterbench.vqa.scoring import is_right, parse_answer

pytestmark = [pytest.mark.physics, pytest.mark.render]
TASK, SIZE = "morning_coffee", 160
VARIATIONS = ("L3", "L4", "T1")
CELLS = tuple(f"{column},{row}" for column in range(8) for row in range(8))
KNOWN = Vocabulary.of(
    ["Where is the red mug in the image?", "Put the blue mug on the ring of the coffee machine."],
    ["mug", "coffee_machine"],
    ["red", "blue"],
)


def learner_at(folder, **changes):
    """Write a learner that was not trained, and return its address."""
    recipe = tiny(history=3, history_stride=2, **changes)
    known = replace(KNOWN, answers=CELLS)
    torch.manual_seed(1)
    weights = new_network(recipe, known).state_dict()
    write_checkpoint(folder / "checkpoint.safetensors", weights, Trained(recipe, known, 12, "none"))
    return f"learned:{folder}"


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    return learner_at(tmp_path_factory.mktemp("learner"))


@pytest.fixture(scope="module")
def learner(address):
    return load_learner(read_address(address))


@pytest.fixture(scope="module")
def run(address, tmp_path_factory):
    plan = make_plan(address, tasks=(TASK,), trials=1, observation="state_only", quality="fast")
    chosen = tuple(t for t in plan.trials if t.variation in VARIATIONS)
    return evaluate(replace(plan, trials=chosen), tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture(scope="module")
def diagnosis(run):
    return diagnose_run(run)


@pytest.fixture(scope="module")
def answers(learner, run, diagnosis):
    return ask_about_run(learner, run, diagnosis, open_photos=lambda: ViewRenderer(run, size=SIZE, quality="fast"))


def test_the_named_mug_is_asked_for_in_each_trial_where_something_is_to_be_done(answers):
    assert [a.where for a in answers] == [f"{TASK}/L3"] * 2 * TIMES_ASKED + [f"{TASK}/L4"] * 2 * TIMES_ASKED
    assert [a.object for a in answers] == ["red_mug"] * 2 * TIMES_ASKED + ["blue_mug"] * 2 * TIMES_ASKED
    assert all(a.object.replace("_", " ") in a.question.lower() for a in answers)
    assert len({a.question for a in answers}) == len(answers)  # each in other words
    assert {a.row for a in answers} == {0}  # at the start, before its first decision
    assert {a.answer for a in answers} <= set(CELLS)


def test_the_right_cell_is_that_in_which_the_object_is_seen(answers, run):
    for answer in answers:
        _, condition, seed = answer.trial.split("/")
        record = run.read_record(TASK, condition, int(seed))
        with ViewRenderer(run, size=SIZE, quality="fast") as photos:
            left, top, right, bottom = photos.photo(record, 0, "front").view.objects[answer.object].box
        assert answer.cell == f"{int((left + right) / 2 // (SIZE / 8))},{int((top + bottom) / 2 // (SIZE / 8))}"


def test_the_mug_of_the_other_color_lies_in_another_cell(learner, run, diagnosis, answers, monkeypatch):
    """Who names the slot in which training had that color names the other mug, and that is said."""
    red, blue = (next(a.cell for a in answers if a.object == name) for name in ("red_mug", "blue_mug"))
    assert red != blue

    def ask(named):
        monkeypatch.setattr(module, "own_answers", lambda _learner, _record, _row, qs: tuple(map(named, qs)))
        return ask_about_run(learner, run, diagnosis, open_photos=lambda: ViewRenderer(run, size=SIZE, quality="fast"))

    knowing = ask(answer_class)
    assert all(a.right and a.means_it and a.nearest == a.object for a in knowing)
    everything = list(summaries_of(knowing))[-1]
    assert (everything.where, everything.nearest.k, everything.trials.k, everything.trials.n) == ("all", 8, 2, 2)
    swapped = ask(lambda q: blue if answer_class(q) == red else red)
    assert {(a.object, a.nearest) for a in swapped} == {("red_mug", "blue_mug"), ("blue_mug", "red_mug")}
    assert not any(a.right or a.means_it for a in swapped)
    assert list(summaries_of(swapped))[-1].nearest.k == 0
    assert {a.nearest for a in ask(lambda _: "Yes")} == {""}
    half = ask(lambda q: answer_class(q) if q.family == "box of" else "Yes")
    summary = next(iter(summaries_of(half)))
    assert (summary.where, summary.cells.k, summary.cells.n, summary.trials.k) == (f"{TASK}/L3", 2, 4, 0)


def test_it_is_shown_what_its_training_shows_with_the_same_question(tmp_path, monkeypatch):
    demonstrations = start_run(tmp_path / "run", TRIALS)
    records = dict(zip(TRIALS, short_records(), strict=True))
    for record in records.values():
        add_record(demonstrations, record)
    asked = [question(trial, row, text=f"Is there a mug at {row}?") for trial in TRIALS for row in (0, 3, 8)]
    made = asked_set(tmp_path / "questions", asked)
    recipe = tiny(
        data=[str(demonstrations.path)], history=3, history_stride=2, validation=0.0,
        co_training={"sets": [str(made.path)], "weight": 0.5},
    )  # fmt: skip
    data = read_training_set(recipe)
    torch.manual_seed(2)
    network = new_network(recipe, data.vocabulary).eval()
    learner, caught = Learner(network, Trained(recipe, data.vocabulary, 1, "none")), []
    with torch.inference_mode():
        shown = Batches(data, recipe, "cpu").questions(np.arange(len(asked)), training=False).shown
        expected = network.reply(shown)
    reply = network.reply
    monkeypatch.setattr(network, "reply", lambda shown: caught.append(reply(shown)) or caught[-1])
    for number, episode in enumerate(data.questions.episodes):
        trial = data.trials[episode]
        rows = sorted((q.id, q) for q in asked if q.source.trial == trial)
        _, q = rows[number - int(np.flatnonzero(data.questions.episodes == episode)[0])]
        (answer,) = own_answers(learner, records[trial], q.source.row, [q])
        assert torch.allclose(caught[-1][0], expected[number], atol=1e-5)
        assert answer == data.vocabulary.answers[int(expected[number].argmax())]
    assert len({tuple(row.tolist()) for row in expected}) == len(asked)  # each row and question counts


def test_only_failed_trials_are_asked_about_if_that_is_wanted(learner, run, diagnosis):
    passed = replace(diagnosis, trials=tuple(t for t in diagnosis.trials if t.success))
    with pytest.raises(InvalidInputError, match="no trials are left"):
        ask_about_run(
            learner, run, passed, open_photos=lambda: ViewRenderer(run, size=SIZE, quality="fast"), failures_only=True
        )


def test_another_learner_than_that_which_played_is_refused(run, diagnosis, tmp_path):
    def ask(other):
        return ask_about_run(other, run, diagnosis, open_photos=lambda: ViewRenderer(run, size=SIZE, quality="fast"))

    stranger = Learner.load(_written(tmp_path / "a", seed=7))
    with pytest.raises(InvalidInputError, match=r"used other weights.*Use the checkpoint that was evaluated"):
        ask(stranger)
    with pytest.raises(InvalidInputError, match=r"trained without questions.*co_training"):
        ask(Learner.load(_written(tmp_path / "b", answers=())))
    with pytest.raises(InvalidInputError, match="uses images"):
        ask(Learner.load(_written(tmp_path / "c", **PIXELS)))


def _written(folder, *, seed=1, answers=CELLS, **changes):
    folder.mkdir()
    known, recipe = replace(KNOWN, answers=answers), tiny(**changes)
    torch.manual_seed(seed)
    path = folder / "checkpoint.safetensors"
    write_checkpoint(path, new_network(recipe, known).state_dict(), Trained(recipe, known, 12, "none"))
    return path


def test_the_command_prints_what_it_answered(address, run, answers, capsys, tmp_path):
    command = ["vqa", "--run", str(run.path), "--learner", address, "--size", str(SIZE)]
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [a["answer"] for a in told["answers"]] == [a.answer for a in answers]
    assert [s["where"] for s in told["summaries"]] == [f"{TASK}/L3", f"{TASK}/L4", "all"]
    assert main(command) == 0
    assert f"{TASK}/L3" in capsys.readouterr().out
    for changed, problem in (
        (["vqa", str(run.path), "--learner", address], "--run RUN"),
        ([*command, "--out", str(tmp_path / "set")], "--out"),
        (["vqa", "--run", str(run.path), "--learner", "expert"], "learned:CHECKPOINT"),
    ):
        assert main(changed) == 2
        assert problem in " ".join(capsys.readouterr().err.split())


@pytest.fixture(scope="module")
def moments(run, diagnosis, tmp_path_factory):
    options = DecisiveOptions(cameras=("front",), size=SIZE, quality="fast")
    return make_decisive_set(
        run, diagnosis, tmp_path_factory.mktemp("moments") / "set", options,
        open_photos=lambda: ViewRenderer(run, size=SIZE, quality="fast"),
    )  # fmt: skip


def test_an_option_that_is_a_box_is_learned_as_its_cell(moments):
    boxes = [q for q in moments.questions if q.role in ("asked", "where") and q.answer.startswith("[")]
    assert boxes
    for q in boxes:
        assert learned_class(q) == option_class(q.answer, q.width)
        assert learned_class(q) in CELLS
    other = next(q for q in moments.questions if q.form is Form.YES_NO)
    assert learned_class(other) == other.answer


def test_a_learner_that_knows_the_cell_gives_the_letter_of_its_box(learner, run, moments, monkeypatch):
    model = LearnerModel("mine", learner, moments, run)
    known = learner.trained.vocabulary.answers
    monkeypatch.setattr(
        answering, "answer_scores",
        lambda _learner, _record, _row, q: np.array([name == learned_class(q) for name in known], dtype=np.float32),
    )  # fmt: skip
    asked = [q for q in moments.questions if learned_class(q) in CELLS]
    for q in asked:
        said = model.answer(prompt_for(q), [moments.image(q.image)])
        classes = [option_class(option, q.width) for option in q.options]
        if classes.count(learned_class(q)) == 1:
            assert is_right(q, parse_answer(q, said).answer)
        else:  # two boxes in one cell: one of them is chosen
            assert classes["ABCDEF".index(said)] == learned_class(q)


def test_what_it_cannot_answer_is_refused_with_a_reason(learner, run, moments):
    model = LearnerModel("mine", learner, moments, run)
    q = next(q for q in moments.questions if q.form is Form.YES_NO)
    with pytest.raises(RefusedError, match=r"none of the answers .* occurred in training"):
        model.answer(prompt_for(q), [moments.image(q.image)])  # it learned cells alone
    with pytest.raises(RefusedError, match="can only answer the questions of the set"):
        model.answer("Where is the mug?", [moments.image(q.image)])
    with pytest.raises(RefusedError, match="can only answer the questions of the set"):
        model.answer(prompt_for(q), [b"another image"])


def test_the_command_evaluates_a_learner_and_its_answers_are_set_against_its_deeds(
    address,
    run,
    moments,
    tmp_path,
    capsys,
):
    line = ["vlm", "--data", str(moments.path), "--model", address, "--out", str(tmp_path / "static")]
    assert main([*line, "--records", str(run.path), "--acted", str(run.path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["n"] == len(moments.questions)
    assert "gaps" in told["acted_gap"]
    answers = str(tmp_path / "static" / "answers.jsonl")
    command = ["diagnose", str(run.path), "--answers", answers, "--questions", str(moments.path), "--json", "--keep"]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["knowledge"]["groups"][0]["name"] == "all"
    for changed, problem in (
        (line, "--records: is missing"),
        ([*line, "--records", str(run.path), "--eyes", "tile-1"], "--eyes: this option does not apply to a learner"),
        (["vlm", "egoplan2", *line[1:]], "a learner can only answer questions about recorded"),
        (["vlm", "egoplan2", "--model", "http://localhost:1/v1#m", "--acted", str(run.path)], "--acted"),
        (
            [*line[:4], "http://localhost:1/v1#m", *line[5:], "--records", str(run.path)],
            "applies only to a learned policy",
        ),
    ):
        assert main(changed) == 2
        assert problem in " ".join(capsys.readouterr().err.split())


def test_a_set_about_other_records_is_refused(learner, run, moments):
    other = replace(moments, records=dict.fromkeys(moments.records, "0" * 64))
    with pytest.raises(InvalidInputError, match="is not the record from which"):
        LearnerModel("mine", learner, other, run)
    q = moments.questions[0]
    stranger = replace(q, source=replace(q.source, seed=999))
    with pytest.raises(InvalidInputError, match=r"--records.*has no trial .*999"):
        LearnerModel("mine", learner, replace(moments, questions=(stranger,)), run)
