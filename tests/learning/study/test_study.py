"""A study goes from its plan to its page, in any number of sittings to the same numbers."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.looping import each

sys.path.insert(0, str(Path(__file__).parent))

import yaml
from workshop import made_up_workshop

from betterbench.errors import BetterError, InvalidInputError, RecordError, UnknownNameError
from betterbench.json_form import sealed_form
from betterbench.learning.study import stages
from betterbench.learning.study.contrasts import contrast_of
from betterbench.learning.study.findings import findings_of
from betterbench.learning.study.page import FILES, expectations, write_page
from betterbench.learning.study.plan import PRESETS, PlannedLearner, StudyPlan, preset_text, read_study_plan
from betterbench.learning.study.stages import run_study
from betterbench.learning.study.vocabulary import never_shown
from betterbench.tasks import task_names

TASK = "morning_coffee"
KEPT = [name for name in FILES if name != "study.html"]


def small(**changes):
    return read_study_plan({"tasks": [TASK], "seeds": [0, 1], "trials": 4, "recipe": {"steps": 10}, **changes})


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    out = tmp_path_factory.mktemp("study") / "whole"
    workshop, calls = made_up_workshop()
    told = []
    outcome = run_study(small(), out, workshop, on_progress=told.append)
    return out, outcome, write_page(outcome, out), calls, told


def contents(out):
    return {name: (out / name).read_bytes() for name in KEPT}


def test_every_learner_is_trained_and_evaluated_once(undisturbed):
    out, outcome, _, calls, told = undisturbed
    names = [f"{TASK}-{arm}-seed{seed}" for seed in (0, 1) for arm in ("confounded", "balanced", "covered")]
    assert calls[:3] == [f"set {TASK}-{regime}" for regime in ("training", "balanced", "covered")]
    assert calls[3:] == [f"{what} {name}" for name in names for what in ("train", "evaluate")]
    assert [f.learner.name for f in outcome.learners] == names
    assert all(p.stages == 15 and 1 <= p.number <= 15 for p in told)
    assert [p.number for p in told] == sorted(p.number for p in told)
    with (out / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert (
        len(rows)
        == sum(len(f.trials) for f in outcome.learners)
        == json.loads((out / "study.json").read_text())["trials"]
    )


def test_learners_that_are_trained_side_by_side_are_the_same(undisturbed, tmp_path):
    whole, _, _, calls, _ = undisturbed
    workshop, again = made_up_workshop(threads=4)
    told = []
    write_page(run_study(small(), tmp_path, workshop, on_progress=told.append), tmp_path)
    assert contents(tmp_path) == contents(whole)
    assert sorted(again) == sorted(calls)
    kinds = [call.partition(" ")[0] for call in again]
    assert kinds == ["set"] * 3 + ["train"] * 4 + ["evaluate"] * 4 + ["train"] * 2 + ["evaluate"] * 2
    assert [p.number for p in told] == sorted(p.number for p in told)
    assert {p.stages for p in told} == {15}
    assert f"learner {TASK}-balanced-seed1, {TASK}-covered-seed1" in {p.name for p in told}


def test_a_group_of_which_some_are_trained_already_trains_the_others(undisturbed, tmp_path):
    calls = undisturbed[3]
    run_study(small(seeds=[0]), tmp_path, made_up_workshop()[0])
    (tmp_path / "stages" / f"learners-{TASK}-balanced-seed0.json").unlink()
    workshop, again = made_up_workshop(threads=8)
    write_page(run_study(small(), tmp_path, workshop), tmp_path)
    trained = [call for call in again if call.startswith("train")]
    assert trained == [f"train {TASK}-balanced-seed0", *(c for c in calls if c.startswith("train") and "seed1" in c)]
    assert contents(tmp_path) == contents(undisturbed[0])


@pytest.mark.slow
def test_a_study_that_is_killed_anywhere_ends_with_the_same_numbers(undisturbed, tmp_path):
    whole, _, _, calls, _ = undisturbed
    for stop_at in range(len(calls)):
        child = os.fork()
        if not child:
            workshop, _ = made_up_workshop(stop_at, lambda: os.kill(os.getpid(), signal.SIGKILL))
            run_study(small(), tmp_path / str(stop_at), workshop)
            os._exit(1)
        assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL
        workshop, again = made_up_workshop()
        write_page(run_study(small(), tmp_path / str(stop_at), workshop), tmp_path / str(stop_at))
        assert again == calls[stop_at:]
        assert contents(tmp_path / str(stop_at)) == contents(whole)


def test_ctrl_c_keeps_what_is_done_and_a_larger_plan_goes_on(undisturbed, tmp_path):
    calls = undisturbed[3]

    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(small(seeds=[0]), tmp_path, made_up_workshop(5, interrupt)[0])
    workshop, again = made_up_workshop()
    run_study(small(seeds=[0]), tmp_path, workshop)
    assert again == calls[5:9]
    workshop, more = made_up_workshop()
    write_page(run_study(small(), tmp_path, workshop), tmp_path)
    assert more == calls[9:]
    assert contents(tmp_path) == contents(undisturbed[0])
    workshop, more = made_up_workshop()
    run_study(small(trials=5), tmp_path, workshop)
    assert more == [call for call in calls if call.startswith("evaluate")]  # more trials need no other learners


def test_a_set_whose_conditions_have_changed_is_made_again(undisturbed, tmp_path, monkeypatch):
    run_study(small(seeds=[0]), tmp_path, made_up_workshop()[0])
    known = stages.conditions_of
    monkeypatch.setattr(
        stages, "conditions_of", lambda task, regime: known(task, regime)[: 3 if regime == "balanced" else None]
    )
    workshop, again = made_up_workshop()
    run_study(small(seeds=[0]), tmp_path, workshop)
    assert again == [f"set {TASK}-balanced"]  # which came out the same here, so that its learner stands


def test_a_stage_file_that_is_damaged_is_named(undisturbed, tmp_path):
    run_study(small(seeds=[0]), tmp_path, made_up_workshop()[0])
    file = tmp_path / "stages" / f"runs-{TASK}-balanced-seed0.json"
    file.write_bytes(file.read_bytes()[:50])
    with pytest.raises(RecordError, match=rf"{file.name}.*Delete the file"):
        run_study(small(seeds=[0]), tmp_path, made_up_workshop()[0])


def test_what_is_found_is_what_the_learners_did(undisturbed):
    _, _, found, _, _ = undisturbed
    assert found.roles == {"confounded": "confounded", "balanced": "balanced", "covered": "covered"}
    by_name = {v.variation: v for v in found.variations}
    assert {n: v.verdict for n, v in by_name.items()} == {
        "L1": "no gap",
        "L2": "no gap",
        "L3": "decorrelation is enough",
        "L4": "decorrelation is enough",
        "O1": "decorrelation is enough",
        "T1": "open",  # the balanced learners solve half of it
    }
    risky = [v for v in found.variations if v.risk]
    for v in risky:
        assert v.labels[0] == (v.predicted, 8)
        assert v.gaps["confounded"].value == pytest.approx(1.0)
        if v.variation != "T1":
            assert v.validity is not None
            assert v.validity.value == pytest.approx(1.0)
            assert 0.5 < v.validity.low < 1.0 < v.validity.high
    assert by_name["T1"].validity.value == pytest.approx(0.5)
    contrast = found.contrasts[0]
    assert contrast.learners == 2
    assert contrast.gap.value == pytest.approx(0.5 / 6 - 4 / 6)
    assert contrast.gap.low < contrast.gap.value < contrast.gap.high < 0.0
    assert contrast.gap.p_value == pytest.approx(0.5)  # two pairs of learners cannot show more
    assert contrast.success.low > 0.0
    assert found.prediction.area.value == pytest.approx(1.0)
    assert found.prediction.area.low < 0.9
    assert found.prediction.label.value == pytest.approx(1.0)
    words = {w.arm: w.changed.value for w in found.words}
    assert words["confounded"] < words["balanced"] == 1.0
    assert [line.held for line in expectations(found)[:2]] == [True, True]


ARMS_OF_COVERAGE = {
    "confounded": {"training": 1.0},
    "tied": {"diverse-confounded": 1.0},
    "balanced": {"balanced": 1.0},
}


def coverage_study(out, solved_by_the_tied):
    """Return a study whose diverse-confounded learners solve some variations only."""
    workshop, calls = made_up_workshop()
    outcome = run_study(small(arms=ARMS_OF_COVERAGE), out, workshop)
    learners = tuple(
        replace(
            f,
            trials=tuple(
                replace(t, success=t.variation is None or t.variation in solved_by_the_tied) for t in f.trials
            ),
        )
        if f.learner.arm == "tied"
        else f
        for f in outcome.learners
    )
    outcome = replace(outcome, learners=learners)
    return outcome, write_page(outcome, out), calls


def test_a_diverse_confounded_arm_tells_coverage_from_decorrelation(tmp_path):
    _, found, calls = coverage_study(tmp_path, {"L1", "L2", "L3"})
    assert f"set {TASK}-diverse-confounded" in calls
    assert found.roles["diverse-confounded"] == "tied"
    verdicts = {v.variation: v.verdict for v in found.variations}
    assert verdicts["L3"] == "coverage is enough"
    assert verdicts["L4"] == verdicts["O1"] == "decorrelation is enough"
    assert {c.name for c in found.coverage} == {
        "diverse-confounded against confounded",
        "balanced against diverse-confounded",
    }
    by_pair = {c.name: c for c in found.coverage if not c.task}
    assert by_pair["diverse-confounded against confounded"].success.value == pytest.approx((3 - 2) / 6)
    assert by_pair["balanced against diverse-confounded"].success.value == pytest.approx((5.5 - 3) / 6)
    assert by_pair["balanced against diverse-confounded"].learners == 2
    page = (tmp_path / "study.html").read_text()
    assert 'id="coverage"' in page
    assert page.index("Diverse-confounded against confounded") < page.index("Balanced against diverse-confounded")
    with (tmp_path / "numbers.csv").open(newline="") as file:
        named = {row["arm"] for row in csv.DictReader(file) if row["table"] == "contrasts"}
    assert named >= by_pair.keys()
    assert {c["name"] for c in json.loads((tmp_path / "study.json").read_text())["coverage"]} == by_pair.keys()


@pytest.mark.parametrize(("solved", "held"), [({"L1", "L2"}, True), ({"L1", "L2", "L3", "L4", "O1"}, False)])
def test_what_decorrelation_adds_to_coverage_is_expected_before(tmp_path, solved, held):
    _, found, _ = coverage_study(tmp_path, solved)
    (line,) = (x for x in expectations(found) if "diverse-confounded" in x.expected)
    assert "20 points" in line.expected
    assert line.held is held


def test_without_such_an_arm_nothing_is_said_of_coverage(undisturbed):
    out, _, found, _, _ = undisturbed
    assert found.coverage == ()
    assert 'id="coverage"' not in (out / "study.html").read_text()
    assert not any("diverse" in line.expected for line in expectations(found))


def test_an_arm_that_a_task_has_no_conditions_for_is_refused(tmp_path):
    with pytest.raises(InvalidInputError, match=r"fast_food has no diverse-confounded.*dinner_plates, morning_coffee"):
        read_study_plan({"tasks": [TASK, "fast_food"], "arms": ARMS_OF_COVERAGE})


@pytest.mark.parametrize(
    ("task", "variation", "regimes", "new"),
    [
        ("morning_coffee", "O1", ["training"], ("can",)),
        ("morning_coffee", "O1", ["training", "balanced"], ()),
        ("fruit_lunch", "T2", ["balanced"], ("both", "apples")),
        ("desk_meeting", "O1", ["balanced"], ("soap_bar", "gray")),
        ("fruit_lunch", "R1", ["training"], ()),
        ("fruit_lunch", "T2", ["covered"], ()),
    ],
)
def test_what_training_never_showed_of_a_variation_is_named(task, variation, regimes, new):
    assert never_shown(regimes, task, variation) == new


def test_variations_without_anything_new_are_counted_apart(undisturbed):
    """Can stands in O1 alone, which the confounded learners fail: it is left out, and the others are as they are."""
    out, outcome, found, _, _ = undisturbed
    assert {v.variation: v.never_shown for v in found.variations if v.never_shown} == {"O1": ("can",)}
    assert found.known.variations == 5
    balanced = [t for f in outcome.learners if f.learner.arm == "balanced" for t in f.varied if t.variation != "O1"]
    assert (found.known.balanced.k, found.known.balanced.n) == (sum(t.success for t in balanced), len(balanced))
    assert found.known.contrast.gap.value == pytest.approx(0.5 / 5 - 3 / 5)
    assert "never shown: can" in (out / "study.html").read_text()


def test_a_verdict_is_asked_of_learners_that_it_does_not_rest_on(undisturbed):
    out, outcome, found, _, _ = undisturbed
    balanced = [f for f in outcome.learners if f.learner.arm == "balanced"]
    enough = [v.variation for v in found.variations if v.verdict == "decorrelation is enough"]
    trials = [t for f in balanced for name in enough for t in f.of(name)]
    assert found.repeated.variations == len(balanced) * len(enough) == 6  # "no gap" is no such verdict
    assert (found.repeated.success.k, found.repeated.success.n) == (sum(t.success for t in trials), len(trials))
    assert "left_out_success" in (out / "numbers.csv").read_text()
    alone = findings_of(outcome.plan, [f for f in outcome.learners if f.learner.seed == 0], {})
    assert alone.repeated is None


def test_a_verdict_that_the_learner_left_out_does_not_share_lowers_what_is_repeated(undisturbed):
    _, outcome, found, _, _ = undisturbed
    last = max(f.learner.seed for f in outcome.learners)
    fails = [
        replace(f, trials=tuple(replace(t, success=False) for t in f.trials)) if f.learner.seed == last else f
        for f in outcome.learners
    ]
    assert findings_of(outcome.plan, fails, {}).repeated.success.value == 0.0 < found.repeated.success.value


def test_nothing_is_repeated_by_learners_that_learned_nothing(undisturbed):
    """Of a variation in which doing nothing is right all learners solve all, and of training none does anything."""
    _, outcome, _, _, _ = undisturbed
    idle = [
        replace(
            f,
            trials=tuple(
                replace(t, success=t.variation in ("L3", "T1") and (t.variation == "T1" or f.learner.arm == "balanced"))
                for t in f.trials
            ),
        )
        for f in outcome.learners
    ]
    found = findings_of(outcome.plan, idle, {})
    assert found.repeated.success.value == 1.0
    line = next(e for e in expectations(found) if "decorrelation is enough according to" in e.expected)
    assert line.held is None
    assert "of the training conditions" in line.found


def test_the_page_needs_nothing_else_and_says_what_one_seed_cannot(undisturbed, tmp_path):
    page = (undisturbed[0] / "study.html").read_text()
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")
    assert "Construct validity" in page
    assert "fewer than three training seeds" in page
    outcome = run_study(small(seeds=[0, 1, 2]), tmp_path, made_up_workshop()[0])
    write_page(outcome, tmp_path)
    assert "fewer than three" not in (tmp_path / "study.html").read_text()


def test_nothing_is_concluded_from_learners_that_learned_nothing(undisturbed):
    _, outcome, _, _, _ = undisturbed
    failed = [
        replace(f, trials=tuple(replace(t, success=False, label="timeout") for t in f.trials)) for f in outcome.learners
    ]
    lines = expectations(findings_of(outcome.plan, failed, {}))
    assert len(lines) == 4
    assert all(line.held is None and "solve only 0\u202f% of the training conditions" in line.found for line in lines)


def test_levers_and_doses_have_tables_of_their_own(tmp_path):
    arms = {"confounded": {"training": 1.0}, "half": {"training": 0.5, "balanced": 0.5}, "free": {"balanced": 1.0}}
    levers = [{"name": "large", "changes": {"capacity": "large"}}, {"name": "on", "changes": {}, "start": "free"}]
    plan = small(seeds=[0], arms=arms, levers=levers, demos=40)
    workshop, calls = made_up_workshop()
    found = write_page(run_study(plan, tmp_path, workshop), tmp_path)
    assert {f"set {TASK}-training", f"set {TASK}-training-20", f"set {TASK}-balanced-20"} <= set(calls)
    overall = [d for d in found.doses if not d.task]
    assert [(d.dose, d.arm) for d in overall] == [(0.0, "free"), (0.5, "half"), (1.0, "confounded")]
    (table,) = found.levers
    assert (table.arm, table.tasks, table.seeds) == ("confounded", (TASK,), 1)
    plain, large, on = table.rows
    assert (plain.start, large.start, on.start) == (None, None, "free")
    assert "on, begins with free" in (tmp_path / "study.html").read_text()
    assert (plain.found.lever, plain.against, large.found.lever) == ("", None, "large")
    assert plain.axes == large.axes
    assert sum(f.k for f in plain.axes.values()) == plain.found.variations.k
    assert list(plain.axes) == ["spatial_layout_shift", "adversarial_object_perturbation", "temporal_extrapolation"]
    assert large.against.gap.value == pytest.approx(0.0)
    assert large.against.success.p_value is None  # of one pair of learners nothing is known about others
    rows = (tmp_path / "numbers.csv").read_text().splitlines()
    assert sum(row.startswith("levers,") for row in rows) == 3 * 3 + 2 * 2
    assert "Failure by dose" in (tmp_path / "study.html").read_text()


def test_a_lever_may_be_compared_with_another_one(tmp_path):
    """The balanced learners of the made-up workshop fail a part of one variation, the confounded ones all of some."""
    levers = [
        {"name": "tuned", "changes": {}, "start": "balanced"},
        {"name": "frozen", "changes": {"frozen": ["objects"]}, "start": "balanced", "against": "tuned"},
        {"name": "slow", "changes": {"steps": 11}, "against": "tuned"},
    ]
    workshop, _ = made_up_workshop()

    def evaluate(policy, task, trials, out, tell):
        digest = f"{task}-balanced" if "tuned" in out.name or "frozen" in out.name else policy.digest
        return workshop.evaluate(replace(policy, digest=digest), task, trials, out, tell)

    outcome = run_study(small(seeds=[0], levers=levers), tmp_path, replace(workshop, evaluate=evaluate))
    (table,) = write_page(outcome, tmp_path).levers
    plain, tuned, frozen, slow = table.rows
    assert [row.compared for row in table.rows] == [None, None, "tuned", "tuned"]
    assert tuned.against.success.value > 0.0 == frozen.against.success.value
    assert slow.against.success.value == -tuned.against.success.value
    assert plain.against is None
    page = (tmp_path / "study.html").read_text()
    assert "frozen, begins with balanced, against tuned" in page
    assert "slow, against tuned" in page


def test_a_lever_with_questions_has_them_asked_about_the_sets_of_its_arm(tmp_path):
    arms = {"confounded": {"training": 1.0}, "half": {"training": 0.5, "balanced": 0.5}}
    lever = {"name": "asked", "changes": {"co_training": {"weight": 0.5}}, "questions": 300, "arms": ["half"]}
    plan, jobs = small(seeds=[0, 1], arms=arms, levers=[lever], demos=40), []
    workshop, calls = made_up_workshop()

    def train(given, tell):
        jobs.extend(given)
        return workshop.train(given, tell)

    told = []
    run_study(plan, tmp_path, replace(workshop, train=train), on_progress=told.append)
    names = [f"{TASK}-{regime}-20-300-questions" for regime in ("training", "balanced")]
    assert [call for call in calls if call.startswith("ask")] == [f"ask {name}" for name in names]
    assert {p.stages for p in told} == {3 + 2 + 2 * 6}
    asked = [job for job in jobs if job.out.name.startswith(f"{TASK}-half-asked-")]
    assert len(asked) == 2
    for job in asked:
        assert job.recipe.co_training.sets == tuple(str(tmp_path / "questions" / name) for name in names)
        assert job.recipe.co_training.weight == 0.5
    assert all(job.recipe.co_training is None for job in jobs if job not in asked)
    calls.clear()
    run_study(plan, tmp_path, workshop)
    assert calls == []
    more = small(seeds=[0, 1], arms=arms, levers=[{**lever, "questions": 400}], demos=40)
    run_study(more, tmp_path, workshop)
    assert [call.partition(" ")[0] for call in calls] == ["ask", "ask", "train", "train"]  # to the same two policies


@each("demos", [2, 3, 5, 10, 25, 40])
@each("share", [0.001, 0.05, 0.5, 0.7, 0.95, 0.999])
def test_arms_share_out_all_their_demonstrations_and_doses_are_those_that_were_shown(demos, share):
    arms = {"mixed": {"training": share, "balanced": 1.0 - share}}
    plan = small(arms=arms, demos=demos)
    shown = plan.sets_of("mixed")
    assert sum(shown.values()) == demos
    assert all(count >= 1 for count in shown.values())
    assert abs(shown["training"] - share * demos) <= 1.0
    assert plan.dose_of("mixed") == shown["training"] / demos


def test_questions_that_cannot_be_read_stop_a_study_before_it_begins(tmp_path):
    lever = {"name": "asked", "changes": {"co_training": {"sets": [str(tmp_path / "nowhere")]}}}
    workshop, calls = made_up_workshop()
    with pytest.raises(BetterError, match="nowhere"):
        run_study(small(levers=[lever]), tmp_path / "study", workshop)
    assert calls == []


def test_questions_about_other_demonstrations_stop_a_study_before_a_learner_is_trained(tmp_path, monkeypatch):
    """Each choice of demonstrations and questions is looked at once, as soon as there are demonstrations."""
    lever = {"name": "asked", "changes": {"co_training": {"sets": ["questions"]}}, "arms": ["balanced", "covered"]}
    monkeypatch.setattr(stages, "read_set", lambda _: SimpleNamespace(sha256="first"))
    workshop, calls = made_up_workshop()
    looked_at = []

    def require_questions(recipe):
        looked_at.append((recipe.data, recipe.co_training.sets))
        if "covered" in recipe.data[0]:
            raise InvalidInputError("co_training: questions", "none of its 3 questions is about it", "Ask again")

    with pytest.raises(InvalidInputError, match="none of its 3"):
        run_study(small(levers=[lever]), tmp_path, replace(workshop, require_questions=require_questions))
    folders = [str(tmp_path / "sets" / f"{TASK}-{regime}") for regime in ("balanced", "covered")]
    assert looked_at == [((folder,), ("questions",)) for folder in folders]
    assert calls
    assert all(call.startswith("set ") for call in calls)


def test_other_questions_of_a_co_training_make_another_learner(tmp_path, monkeypatch):
    lever = {"name": "asked", "changes": {"co_training": {"sets": ["questions"]}, "batch": 8}}
    plan, trained = small(seeds=[0], levers=[lever]), []
    for digest in ("first", "first", "second"):
        monkeypatch.setattr(stages, "read_set", lambda _, digest=digest: SimpleNamespace(sha256=digest))
        workshop, calls = made_up_workshop()
        run_study(plan, tmp_path, workshop)
        trained.append([call for call in calls if call.startswith("train")])
    assert [len(names) for names in trained] == [4, 0, 1]
    assert trained[2] == [f"train {TASK}-confounded-asked-seed0"]


def test_a_lever_begins_with_the_learner_of_another_arm_that_is_trained_before_it(tmp_path):
    """Also where the two would be trained side by side; another such learner makes another one of the lever."""
    lever = {"name": "frozen", "changes": {"frozen": ["objects"]}, "start": "balanced"}
    plan, groups = small(seeds=[0], levers=[lever]), []
    workshop, calls = made_up_workshop(threads=9)
    jobs = []

    def train(given, tell):
        groups.append([job.out.name for job in given])
        jobs.extend(given)
        return workshop.train(given, tell)

    run_study(plan, tmp_path, replace(workshop, train=train))
    assert groups[-1] == [f"{TASK}-confounded-frozen-seed0"]
    assert f"{TASK}-balanced-seed0" in groups[0]
    assert jobs[-1].recipe.start == str(tmp_path / "learners" / f"{TASK}-balanced-seed0")
    assert jobs[-1].recipe.frozen == ("objects",)
    marker = tmp_path / "stages" / f"learners-{TASK}-balanced-seed0.json"
    calls.clear()
    run_study(plan, tmp_path, workshop)
    assert calls == []
    changed = json.loads(marker.read_text())
    changed["output"]["digest"] = "another"
    marker.write_text(json.dumps(sealed_form(changed)))
    run_study(plan, tmp_path, workshop)
    assert f"train {TASK}-confounded-frozen-seed0" in calls


def test_learners_of_pixels_are_evaluated_with_the_eyes_that_they_were_trained_with(tmp_path):
    eyes = {"observation": "default", "views": ["front"], "size": 48, "quality": "standard"}
    lever = {"name": "myopic", "changes": {"family": "pixels", "eyes": eyes}}
    plan, seen = small(seeds=[0], levers=[lever]), {}
    workshop, _ = made_up_workshop()

    def evaluate(policy, task, trials, out, tell):
        seen[out.name] = policy.observation, policy.quality
        return workshop.evaluate(policy, task, trials, out, tell)

    run_study(plan, tmp_path, replace(workshop, evaluate=evaluate))
    assert seen.pop(f"{TASK}-confounded-myopic-seed0") == ("default", "standard")
    assert set(seen.values()) == {("state_only", "fast")}


@each(
    "changes, said",
    [
        ({"arms": {"a": {"training": 0.5}}}, "arms.a.*do not add up to 1"),
        ({"arms": {"a": {"test": 1.0}}}, "arms.a"),
        ({"arms": {"a": {"training": 0.5, "balanced": 0.5}}, "demos": 1}, "arms.a.*1 demonstrations are too few for 2"),
        ({"recipe": {"steps": 0}}, "steps"),
        (
            {"recipe": {"frozen": ["trunk"]}},
            "recipe.frozen.*weights that were never trained.*lever with the field start",
        ),
        ({"levers": [{"name": "x", "changes": {"frozen": ["trunk"]}}]}, "lever x.frozen.*lever with the field start"),
        ({"levers": [{"name": "x", "changes": {}, "start": "none"}]}, "levers\\[0\\].start.*'none'"),
        (
            {"levers": [{"name": "x", "changes": {"co_training": {"sets": ["q"]}}, "start": "balanced"}]},
            "lever x.co_training.*other questions",
        ),
        (
            {
                "levers": [
                    {
                        "name": "x",
                        "changes": {"frozen": ["words", "objects", "state", "trunk", "head"]},
                        "start": "balanced",
                    }
                ]
            },
            "lever x.*frozen.*all parts are frozen",
        ),
        (
            {
                "arms": {"a": {"training": 1.0}, "a-x": {"balanced": 1.0}},
                "levers": [{"name": "x", "changes": {"steps": 5}, "arms": ["a"]}],
            },
            "levers.*two learners would be named morning_coffee-a-x-seed0",
        ),
        (
            {"levers": [{"name": "x", "changes": {"capacity": "large"}, "start": "balanced"}]},
            "lever x.capacity.*the learner of balanced",
        ),
        (
            {"levers": [{"name": "x", "changes": {}, "start": "confounded", "arms": ["balanced"]}]},
            "levers\\[0\\].start.*morning_coffee was not trained on .*, but balanced is",
        ),
        (
            {"levers": [{"name": "x", "changes": {"co_training": {"sets": ["q"]}}, "questions": 9}]},
            "lever x.co_training.sets.*makes its own",
        ),
        (
            {"levers": [{"name": "x", "changes": {"co_training": 3}, "questions": 9}]},
            "lever x.co_training.*not a mapping",
        ),
        ({"levers": [{"name": "x", "changes": {}, "questions": -1}]}, "questions"),
        (
            {"levers": [{"name": "x", "changes": {}, "questions": 9, "start": "balanced"}]},
            "lever x.co_training.*other questions",
        ),
        ({"levers": [{"name": "x", "changes": {}, "against": "x"}]}, "levers\\[0\\].against.*'x' is not in the study"),
        (
            {
                "levers": [
                    {"name": "x", "changes": {}, "against": "y", "arms": ["confounded", "balanced"]},
                    {"name": "y", "changes": {}},
                ]
            },
            "levers\\[0\\].against.*y is not applied to balanced",
        ),
        ({"levers": [{"name": "x", "changes": {"start": "learners/x"}}]}, "lever x.start.*is set by the study"),
        ({"recipe": {"seed": 3}}, "recipe.seed.*is set by the study"),
        ({"recipe": {"colour": 3}}, "colour.*unknown"),
        ({"levers": [{"name": "x", "changes": {"capacity": "huge"}}]}, "lever x: capacity"),
        ({"levers": [{"name": "x", "changes": {}, "arms": ["none"]}]}, "levers\\[0\\].arms.*'none'"),
        ({"seeds": [0, 0]}, "seeds.*twice"),
        ({"trials": 0}, "trials"),
        ({"demo": 3}, "demo.*unknown"),
    ],
)
def test_a_wrong_plan_is_one_clear_line(changes, said):
    with pytest.raises(InvalidInputError, match=said):
        small(**changes)


def test_unknown_tasks_and_trials_without_a_certificate_are_refused(tmp_path):
    with pytest.raises((UnknownNameError, InvalidInputError), match="morning_tea"):
        small(tasks=["morning_tea"])
    workshop, calls = made_up_workshop()
    with pytest.raises(BetterError, match="not certified"):
        run_study(small(trials=5000), tmp_path, workshop)
    assert calls == []


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_plans(name):
    plan = read_study_plan(yaml.safe_load(preset_text(name)))
    assert isinstance(plan, StudyPlan)
    if name == "doses":
        planted = sorted(shares["training"] for shares in plan.arms.values())
        assert planted == [0.5, 0.7, 0.85, 0.95, 1.0]
        assert len(plan.tasks) == 2
    else:
        assert plan.arm_in("confounded")
        assert plan.arm_in("balanced")
        assert (plan.arm_in("covered") is None) == (name == "levers")
    if name == "diverse":
        assert plan.arm_in("diverse-confounded")
        assert len(plan.tasks) == 2
        assert len(plan.seeds) == 3
    if name == "full":
        assert len(plan.tasks) >= 4
        assert len(plan.seeds) >= 3
    with pytest.raises(InvalidInputError, match="not a preset"):
        preset_text("huge")


def test_a_learner_of_tests_takes_variations_and_no_other_does():
    plan = small()
    taken = {arm: plan.recipe_of(PlannedLearner(TASK, arm, 0), ("x",)).variations for arm in plan.arms}
    assert taken == {"confounded": False, "balanced": False, "covered": True}


def test_a_learner_without_a_pair_is_left_out_of_a_contrast(undisturbed):
    _, outcome, _, _, _ = undisturbed
    balanced, confounded = ([f for f in outcome.learners if f.learner.arm == arm] for arm in ("balanced", "confounded"))
    lonely = [replace(f, trials=tuple(f.varied)) if f.learner.seed else f for f in balanced]
    assert contrast_of("one against another", TASK, balanced, confounded).learners == 2
    assert contrast_of("one against another", TASK, lonely, confounded).learners == 1


FOREIGN = (None, True, 5, -1.5, "x", [], [[]], {}, {"trials": 5}, {"sha256": 5}, json.loads("[" * 150 + "]" * 150))


@pytest.mark.parametrize(
    "stage", [f"sets-{TASK}-training", f"learners-{TASK}-balanced-seed0", f"runs-{TASK}-balanced-seed0"]
)
def test_a_stage_file_without_a_field_or_with_another_type_is_one_line(undisturbed, tmp_path, stage):
    out = tmp_path / "study"
    shutil.copytree(undisturbed[0], out)
    file = out / "stages" / f"{stage}.json"
    whole = json.loads(file.read_text())
    outputs = [{k: v for k, v in whole["output"].items() if k != field} for field in whole["output"]]
    outputs += [
        {**whole["output"], field: value} for field in whole["output"] for value in FOREIGN if value not in ("x", [])
    ]
    forms = [{**whole, "output": output} for output in (*outputs, *FOREIGN) if output != whole["output"]]
    forms += [{k: v for k, v in whole.items() if k != field} for field in whole]
    forms += [{**whole, "seconds": value} for value in (None, True, "x", [], 10**400)]
    for form in forms:
        file.write_text(json.dumps(form))
        workshop, _ = made_up_workshop()
        with pytest.raises(RecordError, match=stage) as caught:
            run_study(small(), out, workshop)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "address", ["python:evil.py:Policy", "expert", "learned:/elsewhere", "learned:{study}/../x", ""]
)
def test_a_stage_file_cannot_name_another_policy(undisturbed, tmp_path, address):
    out = tmp_path / "study"
    shutil.copytree(undisturbed[0], out)
    (out / "stages" / f"runs-{TASK}-balanced-seed0.json").unlink()
    file = out / "stages" / f"learners-{TASK}-balanced-seed0.json"
    whole = json.loads(file.read_text())
    file.write_text(json.dumps(sealed_form({**whole, "output": {**whole["output"], "address": address}})))
    workshop, calls = made_up_workshop()
    with pytest.raises(RecordError, match=r"output\.address"):
        run_study(small(), out, workshop)
    assert not calls


@pytest.mark.parametrize(
    "changes",
    [
        {"seeds": list(range(12_000))},
        {"arms": {f"arm{i}": {"training": 1.0} for i in range(2000)}},
        {"levers": [{"name": f"l{i}", "changes": {}} for i in range(1500)]},
        {
            "seeds": list(range(30)),
            "levers": [{"name": f"l{i}", "changes": {}, "arms": ["balanced"] * 40} for i in range(40)],
        },
        {"trials": 10_000, "tasks": task_names()},
    ],
    ids=["seeds", "arms", "levers", "repeated", "trials"],
)
def test_a_plan_of_too_much_is_refused_before_it_costs(changes):
    began = time.perf_counter()
    with pytest.raises(InvalidInputError, match=r"at most|more than"):
        small(**changes)
    assert time.perf_counter() - began < 3.0
