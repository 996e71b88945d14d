"""Static twins and the static illusion gap: a model that loses one axis or one relation is named by the table."""

from __future__ import annotations

from fractions import Fraction

import pytest

from betterbench.cli.output.vlm import gap_sentences
from betterbench.diagnosis import Metric
from betterbench.tasks import Axis
from betterbench.vlm.benchmarks.better_vqa import BETTER_VQA, items_of
from betterbench.vlm.scoring import score_answers
from betterbench.vqa import Difficulty, Form, Question, QuestionSet, QuestionType
from betterbench.vqa.coordinates import CONVENTIONS
from betterbench.vqa.question import FrameSource
from betterbench.vqa.twins import axis_of, scene_twin, static_twins

SCENES = ("train1", "train2", "train3", "train4", "L1", "L2", "L3", "L4", "O1", "T1")
"""Conditions of ``morning_coffee``."""
LOST = Axis.SPATIAL_LAYOUT_SHIFT.value


def question(name, condition, seed, *, kind=QuestionType.PREMISE, camera="front", time_s=0.0, **changes):
    source = FrameSource("morning_coffee", condition, seed, round(20 * time_s), time_s, camera)
    return Question(
        id=name, type=kind, form=Form.YES_NO, text=f"{name}?", options=(), answer="Yes", image="images/a.jpg",
        width=64, height=64, difficulty=Difficulty.EASY, tags=(), objects=(), group=("g",), words={}, chance=0.5,
        source=source, **{"family": f"of {kind.value}", **changes},
    )  # fmt: skip


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """Ten seeds of every condition, with two types of question about each."""
    questions = tuple(
        question(f"{scene}-{seed}-{kind.value}", scene, seed, kind=kind)
        for scene in SCENES
        for seed in range(10)
        for kind in (QuestionType.PREMISE, QuestionType.RELATION)
    )
    return QuestionSet(tmp_path_factory.mktemp("set"), "test", questions, (), "0" * 64)


def gaps_of(asked, is_right):
    items = items_of(asked)
    texts = {q.id: q.answer if is_right(q) else "No" for q in asked.questions}
    score = score_answers(BETTER_VQA, items, texts, CONVENTIONS["pixels"])
    return score.gaps, {gap.name: gap for gap in score.gaps.by_column["parsed"]}


def axis(q):
    return axis_of(q.source.task, q.source.condition)


def test_each_question_about_a_variation_has_its_twin_with_the_seed_in_the_training_scene(asked):
    by_id = {q.id: q for q in asked.questions}
    twins = static_twins(asked.questions)
    assert set(twins) == {q.id for q in asked.questions if not q.source.condition.startswith("train")}
    for name, twin in twins.items():
        here, there = by_id[name], by_id[twin]
        assert scene_twin(here.source.trial) == there.source.trial
        assert (here.source.seed, here.type) == (there.source.seed, there.type)
    assert scene_twin(by_id["train1-0-premise"].source.trial) is None


def test_the_twin_is_of_the_same_kind_and_the_nearest_in_camera_and_time():
    here = question("here", "L1", 3, camera="wrist", time_s=2.0)
    base = scene_twin(here.source.trial).condition
    others = [
        question("type", base, 3, kind=QuestionType.RELATION, camera="wrist", time_s=2.0),
        question("family", base, 3, camera="wrist", time_s=2.0, family="another"),
        question("seed", base, 4, camera="wrist", time_s=2.0),
        question("camera", base, 3, time_s=2.0),
        question("late", base, 3, camera="wrist", time_s=9.0),
        question("right", base, 3, camera="wrist", time_s=2.5),
    ]
    assert static_twins([here, *others]) == {"here": "right"}
    assert static_twins([here, *others[:3]]) == {}
    again = question("again", "L1", 3, camera="wrist", time_s=2.0)
    assert set(static_twins([here, again, *others]).values()) == {"right", "late"}  # before a question has two twins


def test_a_model_that_loses_one_axis_is_named_by_the_table(asked):
    gaps, by_name = gaps_of(asked, lambda q: axis(q) != LOST)
    assert (gaps.questions, gaps.paired) == (120, 120)
    assert {gap.name for gap in by_name.values() if gap.kind == "axis" and gap.is_supported} == {LOST}
    lost = by_name[LOST]
    assert (lost.training, lost.variation, lost.difference.value) == (1.0, 0.0, 1.0)
    assert by_name[Axis.TEMPORAL_EXTRAPOLATION.value].difference.value == 0.0
    shown = [gap for gap in by_name.values() if gap.kind == "axis"]
    assert gap_sentences(shown, {}) == ["Supported static gaps: spatial layout shift (+100)."]


def test_a_model_that_loses_one_type_of_question_is_named_by_that_type_and_not_by_an_axis(asked):
    _, by_name = gaps_of(asked, lambda q: q.type is not QuestionType.RELATION)
    assert not any(gap.is_supported for gap in by_name.values())  # lost in training too, so no gap
    _, by_name = gaps_of(asked, lambda q: q.type is not QuestionType.RELATION or axis(q) is None)
    assert {gap.name for gap in by_name.values() if gap.is_supported and gap.kind == "type"} == {"relation"}
    assert by_name["premise"].difference.value == 0.0
    assert by_name[f"{LOST}: relation"].difference.value == 1.0
    assert by_name[f"{LOST}: relation"].p is None


def test_a_model_without_a_gap_has_none_and_its_policy_may_still_lose(asked):
    _, by_name = gaps_of(asked, lambda _: True)
    assert not any(gap.is_supported for gap in by_name.values())
    acted = {"all": Metric("illusion_gap", "overall", None, 60, 0.6, 0.4, 0.8)}
    lines = gap_sentences([by_name["all"]], acted)
    assert lines[0] == "No static gap of an axis or type is supported."
    assert lines[1].startswith("all variations: the policy loses 60 points, the model 0")
    near = {"all": Metric("illusion_gap", "overall", None, 60, 0.1, 0.0, 0.2)}
    assert len(gap_sentences([by_name["all"]], near)) == 1


def test_a_set_without_training_scenes_has_no_gap(asked):
    varied = tuple(q for q in asked.questions if axis(q) is not None)
    alone = QuestionSet(asked.path, "test", varied, (), "1" * 64)
    score = score_answers(BETTER_VQA, items_of(alone), {}, CONVENTIONS["pixels"])
    assert score.gaps is None
    assert score.to_json()["static_gap"] is None
    assert score.headline["parsed"] == Fraction(0)
