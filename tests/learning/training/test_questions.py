"""Questions of a co-training: which are asked, about which frames, and what becomes of their answers."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from asked import asked_set, question
from demonstrating import PaintedPictures, add_record, start_run
from short_records import TRIALS, short_records
from small_recipes import PIXELS, tiny

from betterbench.errors import BetterError, InvalidInputError
from betterbench.interface import observation_spec
from betterbench.learning.training import frames as frames_module
from betterbench.learning.training.data import read_training_set, require_questions
from betterbench.learning.training.questions import AnswerRate, answer_rates, question_text
from betterbench.policies.learned.eyes import looked_at
from betterbench.policies.learned.tokens import moment_of
from betterbench.policies.learned.vocabulary import ABSENT, Vocabulary, words_of
from betterbench.tasks import TrialId
from betterbench.vqa import Form

ROWS = (0, 4, 9, 4)


@pytest.fixture(scope="module")
def records():
    return short_records()


@pytest.fixture
def read(records, tmp_path, monkeypatch):
    """Reads the two short records with questions about them."""
    monkeypatch.setattr(frames_module, "Pictures", PaintedPictures)
    run = start_run(tmp_path / "run", TRIALS)
    for record in records:
        add_record(run, record)

    def read(questions, *, purpose: str = "training", co_training=None, told=None, **changes):
        made = asked_set(tmp_path / "questions", questions, purpose=purpose)
        if told is not None:
            digests = {str(e.key): run.record_digest(e) for e in run.entries()}
            (made.path / "set.json").write_text(json.dumps({"records": digests | told}))
        form = {"sets": [str(made.path)], "weight": 0.5, **(co_training or {})}
        return read_training_set(tiny(data=[str(run.path)], co_training=form, **{"validation": 0.0, **changes}))

    return read


def about(number: int, row: int, **changes):
    return question(TRIALS[number], row, **changes)


def test_questions_about_another_record_of_a_trial_are_left_out(read):
    """A demonstration that was played again under the same name has other answers."""
    asked = [about(0, 2), about(1, 2)]
    assert set(read(asked, told={}).questions.episodes.tolist()) == {0, 1}
    assert set(read(asked, told={str(TRIALS[0]): "0" * 64}).questions.episodes.tolist()) == {1}
    with pytest.raises(InvalidInputError, match="none of its 1 questions is about a demonstration"):
        read(asked[:1], told={str(TRIALS[0]): "0" * 64})


def test_whether_questions_are_about_the_demonstrations_is_known_before_these_are_read(read, tmp_path):
    read([about(0, 2)])
    data = [str(tmp_path / "run")]
    require_questions(tiny(data=data))
    require_questions(tiny(data=data, co_training={"sets": [str(tmp_path / "questions")]}))
    other = asked_set(tmp_path / "other", [question(TrialId("morning_coffee", "train1", 99), 2)])
    with pytest.raises(InvalidInputError, match="none of its 1 questions is about a demonstration"):
        require_questions(tiny(data=data, co_training={"sets": [str(other.path)]}))


def test_a_question_is_asked_of_the_row_that_it_is_about(read, records):
    asked = [about(i % 2, row, answer=("Yes", "No")[i % 2]) for i, row in enumerate(ROWS)]
    data = read(asked, history=2, history_stride=3)
    found = data.questions
    assert data.vocabulary.answers == ("No", "Yes")
    assert sorted(zip(found.episodes.tolist(), found.answers.tolist(), strict=True)) == [(0, 1), (0, 1), (1, 0), (1, 0)]
    pairs = {(q.id): (TRIALS.index(TrialId(q.source.task, q.source.condition, q.source.seed)), q) for q in asked}
    order = sorted(pairs.values(), key=lambda pair: (pair[0], pair[1].id))
    for i, (episode, asked_here) in enumerate(order):
        states = list(records[episode].states())
        row = asked_here.source.row
        tool, poses = moment_of(states[row])
        before, _ = moment_of(states[max(0, row - 3)])
        assert np.array_equal(found.tools[i], np.stack([tool, before]))
        assert np.array_equal(found.poses[i][: len(poses)], poses)
        ids = data.vocabulary.word_ids(question_text(asked_here))
        assert np.array_equal(found.words[i][found.words[i] != ABSENT], ids)
    assert set(words_of(question_text(asked[0]))) <= set(data.vocabulary.words)


def test_a_learner_of_pixels_sees_the_row_that_is_asked_about(read, records):
    asked = [about(1, 9), about(1, 4), about(0, 3)]
    data = read(asked, longest_pause=None, **PIXELS)
    found, recipe = data.questions, tiny(**PIXELS)
    eyes = recipe.eyes
    cameras = PaintedPictures(observation_spec(eyes.observation).only(eyes.cameras).cameras, "fast")
    order = sorted(asked, key=lambda q: (q.source.seed, q.id))
    for i, asked_here in enumerate(order):
        record, row = records[asked_here.source.seed], asked_here.source.row
        view = next(iter(cameras.of(None, record, rows=[row])))
        shown = looked_at(recipe.eyes, view)
        assert np.array_equal(found.frames_of.read(found.frames[i : i + 1])[0], shown)


def test_boxes_are_words_for_cells_and_points_are_answered_by_cells(read):
    box = about(0, 2, form=Form.BOX, answer="[32, 64, 64, 96]", box=(32, 64, 64, 96))
    point = about(0, 3, form=Form.POINT, answer="[250, 5]", box=(240, 0, 256, 10))
    asked = {"text": "What is in the box [0, 0, 31, 31]?", "options": ("mug", "can"), "answer": "can"}
    within = about(1, 4, form=Form.CHOICE, **asked)
    data = read([box, point, within])
    assert data.vocabulary.answers == ("1,2", "7,0", "can")
    assert question_text(within).split() == ["What", "is", "in", "the", "box", "cell0x0", "?", "A.", "mug", "B.", "can"]
    assert "cell0x0" in data.vocabulary.words


def test_questions_about_what_is_held_out_teach_nothing(read):
    apart = [about(0, 2, answer="Yes"), about(1, 2, answer="No", text="Is an okapi there?")]
    data = read(apart, validation=0.5)
    held_out = int(np.flatnonzero(data.held_out)[0])
    assert len(data.asked(held_out=True)) == len(data.asked(held_out=False)) == 1
    assert data.vocabulary.answers == (("No", "Yes")[held_out],)
    assert ("okapi" in data.vocabulary.words) == (held_out == 0)
    assert data.questions.answers[data.asked(held_out=True)].tolist() == [-1]


def test_questions_decide_what_the_data_are(read):
    first = read([about(0, 2)])
    assert first.sha256 != read([about(0, 3)]).sha256
    assert first.sha256 == read([about(0, 2)]).sha256


@pytest.mark.parametrize(
    ("questions", "options", "named"),
    [
        (
            [question(TrialId("morning_coffee", "train1", 99), 2)],
            {},
            "none of its 1 questions is about a demonstration",
        ),
        ([question(TRIALS[0], 2)], {"purpose": "test"}, "evaluation trials"),
        ([question(TRIALS[0], 10)], {}, "about row 10"),
        ([question(TRIALS[0], 2)], {"co_training": {"sets": ["nowhere"]}}, "contains no complete question set"),
    ],
)
def test_a_set_of_which_nothing_can_be_learned_is_one_line(read, questions, options, named):
    with pytest.raises(BetterError, match=named) as error:
        read(questions, **options)
    assert "\n" not in str(error.value)


def test_questions_about_nothing_but_what_is_held_out_are_one_line(read):
    held_out = int(np.flatnonzero(read([about(0, 1), about(1, 1)], validation=0.5).held_out)[0])
    with pytest.raises(InvalidInputError, match="all questions are about held-out demonstrations"):
        read([about(held_out, 1)], validation=0.5)


@pytest.mark.parametrize(
    ("form", "field"),
    [
        ({"sets": []}, "co_training"),
        ({"sets": ["a"], "weight": 0}, "weight"),
        ({"sets": ["a"], "weight": 0.01}, "co_training.weight"),
        ({"sets": ["a"], "share": 0.5}, "share"),
    ],
)
def test_a_wrong_co_training_names_its_field(form, field):
    with pytest.raises(InvalidInputError, match=field):
        tiny(co_training=form)


def test_without_co_training_nothing_is_written_differently():
    assert "co_training" not in tiny().to_json()
    assert "answers" not in Vocabulary(("a",), ("b",), ("c",)).to_json()
    form = tiny(co_training={"sets": ["a"]}).to_json()
    assert form["co_training"] == {"sets": ["a"], "weight": 0.25}
    assert json.loads(json.dumps(form)) == form


def test_rates_are_by_type_and_over_all():
    found = answer_rates(7, ["state", "premise", "state"], [True, False, False])
    assert found == [AnswerRate(7, "premise", 0, 1), AnswerRate(7, "state", 1, 2), AnswerRate(7, "all", 1, 3)]
    assert answer_rates(7, [], []) == []


def test_two_sets_are_asked_together(read, tmp_path):
    other = asked_set(tmp_path / "more", [about(1, 5, text="Is there a lemur?")])
    first = asked_set(tmp_path / "questions", [about(0, 2)])
    data = read([about(0, 2)], co_training={"sets": [str(first.path), str(other.path)]})
    assert sorted(data.questions.episodes.tolist()) == [0, 1]
    assert "lemur" in data.vocabulary.words
    assert dataclasses.replace(data, questions=None).asked(held_out=False).tolist() == []
