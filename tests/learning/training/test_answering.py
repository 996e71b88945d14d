"""A learner answers a set of better vlm: found by image and text, from the state of the frame."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from test_own_answers import CELLS, KNOWN, SIZE, address, diagnosis, learner, learner_at, run  # noqa: F401 - fixtures

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError
from betterbench.evaluation.figures.views import ViewRenderer
from betterbench.learning.training import answering
from betterbench.learning.training.answering import LearnerModel
from betterbench.learning.training.questions import learned_class, option_class
from betterbench.vqa import Form
from betterbench.vqa.asking import prompt_for
from betterbench.vqa.decisive import DecisiveOptions, make_decisive_set
from betterbench.vqa.llm import RefusedError
from betterbench.vqa.scoring import is_right, parse_answer

pytestmark = [pytest.mark.physics, pytest.mark.render]


@pytest.fixture(scope="module")
def moments(run, diagnosis, tmp_path_factory):  # noqa: F811 - the fixtures
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


def test_a_learner_that_knows_the_cell_gives_the_letter_of_its_box(learner, run, moments, monkeypatch):  # noqa: F811
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


def test_what_it_cannot_answer_is_refused_with_a_reason(learner, run, moments):  # noqa: F811
    model = LearnerModel("mine", learner, moments, run)
    q = next(q for q in moments.questions if q.form is Form.YES_NO)
    with pytest.raises(RefusedError, match="none of the answers .* occurred in training"):
        model.answer(prompt_for(q), [moments.image(q.image)])  # it learned cells alone
    with pytest.raises(RefusedError, match="only the questions of the set"):
        model.answer("Where is the mug?", [moments.image(q.image)])
    with pytest.raises(RefusedError, match="only the questions of the set"):
        model.answer(prompt_for(q), [b"another image"])


def test_the_command_evaluates_a_learner_and_its_answers_are_set_against_its_deeds(
    address,
    run,
    moments,
    tmp_path,
    capsys,  # noqa: F811
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
        ([*line, "--records", str(run.path), "--eyes", "tile-1"], "--eyes: it does not apply to a learner"),
        (["vlm", "egoplan2", *line[1:]], "a learner answers only questions about frames"),
        (["vlm", "egoplan2", "--model", "http://localhost:1/v1#m", "--acted", str(run.path)], "--acted"),
        ([*line[:4], "http://localhost:1/v1#m", *line[5:], "--records", str(run.path)], "applies only to a learner"),
    ):
        assert main(changed) == 2
        assert problem in " ".join(capsys.readouterr().err.split())


def test_a_set_about_other_records_is_refused(learner, run, moments):  # noqa: F811
    other = dataclasses.replace(moments, records=dict.fromkeys(moments.records, "0" * 64))
    with pytest.raises(InvalidInputError, match="was made from another record"):
        LearnerModel("mine", learner, other, run)
    q = moments.questions[0]
    stranger = dataclasses.replace(q, source=dataclasses.replace(q.source, seed=999))
    with pytest.raises(InvalidInputError, match=r"--records.*has no trial .*999"):
        LearnerModel("mine", learner, dataclasses.replace(moments, questions=(stranger,)), run)
