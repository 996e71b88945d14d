"""The diagnosis in LIBERO: policies with known faults get their labels, from the records alone."""

import html
import os
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.resealing import rewrite

from betterbench.api.report import ReportListener, build_report
from betterbench.calibration.truth import true_label
from betterbench.diagnosis import diagnose_run, favorite_thing, libero
from betterbench.diagnosis.instruction_effect import SAME_THING
from betterbench.diagnosis.libero import untold_by
from betterbench.errors import InvalidInputError, RecordError
from betterbench.evaluation import evaluate
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.report.headline import headline_of
from betterbench.report.pages.page import write_report
from betterbench.report.pages.trust import trust_of
from betterbench.sim.worlds.installation import Installation, start_code
from betterbench.tasks.labels import all_labels
from betterbench.tasks.worlds.libero_training import trained_in, word_of_sentence

STEPS = 190


@pytest.fixture(scope="module")
def plan_of():
    folder = str(Path(__file__).parent)
    command = (sys.executable, "-c", f"import sys; sys.path.append({folder!r})\n{start_code('fake_table')}")
    made = {}

    def plan(policy, suite="libero_object_swap", steps=STEPS, **options):
        options = {"tasks": ["0", "1"], "trials": 3, **options}
        # A plan starts a simulator, which answers by this variable; a plan that is the same is made once.
        key = repr((policy, suite, sorted(options.items()), os.environ.get("FAKE_LAYOUT")))
        if key not in made:
            made[key] = make_world_plan(policy, suite=suite, command=command, **options)
        plan = made[key]
        protocol = replace(plan.world.protocol, steps={"libero_object": steps})
        return replace(plan, world=replace(plan.world, protocol=protocol))

    return plan


@pytest.fixture
def run_of(plan_of, tmp_path):
    return lambda policy, **options: evaluate(plan_of(policy, **options), tmp_path / "run", workers=1, envs=1)


@pytest.fixture(scope="module")
def still(plan_of, tmp_path_factory):
    """A run of one trial in which nothing is done."""
    folder = tmp_path_factory.mktemp("still") / "run"
    return evaluate(plan_of("noop", trials=1, tasks=["0"]), folder, workers=1, envs=1)


def _truths(run):
    return {f"{e.task}/{e.condition}/{e.seed}": e.ground_truth["truth"] for e in run.entries()}


def test_the_expert_brings_everything_where_it_belongs(run_of):
    run = run_of("expert", trials=1)
    found = diagnose_run(run)
    assert [t.label for t in found.trials] == ["success"] * 2
    assert all(t.intention_correct and t.axis == "spatial_layout_shift" for t in found.trials)
    assert all(t.attempts[0].secured and t.attempts[0].result == "target" for t in found.trials)


@pytest.mark.parametrize(
    ("policy", "label", "failures"),
    [
        ("zoo:lexical", "lexical_kinematic_shortcut", 4),
        ("zoo:layout", "visual_layout_bias", 2),
        ("zoo:clumsy", "execution_failure", 4),
    ],
)
def test_a_policy_with_one_fault_gets_its_label(run_of, policy, label, failures):
    run = run_of(policy, trials=2)
    found = {t.key: t for t in diagnose_run(run).trials}
    failed = [t for t in found.values() if not t.success]
    assert [t.label for t in failed] == [label] * failures
    assert {key: t.label for key, t in found.items() if not t.success} == {
        key: truth for key, truth in _truths(run).items() if truth
    }
    if policy == "zoo:lexical":
        evidence = found["libero_object-00/swap/0"].evidence
        assert "'cube' was picked in training: it is at the ball" in evidence.text
        assert not found["libero_object-00/swap/0"].intention_correct


def test_a_thing_that_is_gone_for_whatever_is_asked(run_of, monkeypatch):
    run = run_of("zoo:layout", tasks=["0"])
    assert {t.label for t in diagnose_run(run).trials} == {"wrong_object"}, "one task shows no place"
    monkeypatch.setattr(favorite_thing, "LEAST_ASKED", 1)
    monkeypatch.setattr(favorite_thing, "LEAST_PAIRS", 3)
    monkeypatch.setattr(favorite_thing, "LEVEL", 0.2)
    found = diagnose_run(run)
    assert {t.label for t in found.trials} == {"visual_layout_bias"}
    assert {t.evidence.rule for t in found.trials} == {SAME_THING}
    assert (
        "It goes for the ball in every scene that contains it, regardless of the instruction: in 3 of 3"
        in found.findings[0]
    )
    assert "one kind of object in every scene" in headline_of(found).conclusion


@pytest.mark.parametrize(
    ("misses", "label"),
    [
        ("0", "behavioral_inertia"),
        pytest.param("1", "behavioral_inertia", marks=pytest.mark.slow),
        ("9", "execution_failure"),
    ],
)
def test_a_habit_of_place_shows_when_something_is_carried_there(run_of, monkeypatch, misses, label):
    monkeypatch.setenv("FAKE_LAYOUT", "basket")
    monkeypatch.setenv("FAKE_MISSES", misses)
    run = run_of("zoo:habit-place", trials=1, tasks=["0"], steps=2 * STEPS)
    (entry,) = run.entries()
    assert true_label(entry.ground_truth, expected="succeed", success=False) == label
    assert [t.label for t in diagnose_run(run).trials] == [label]


def test_a_run_of_the_base_suite_gives_the_twins(plan_of, tmp_path, monkeypatch):
    swap = evaluate(plan_of("zoo:lexical", trials=1), tmp_path / "swap", workers=1, envs=1)
    assert any("pass that run with --twins" in note for note in diagnose_run(swap).notes)
    base_plan = plan_of("zoo:lexical", suite="libero_object", trials=2)
    base = evaluate(base_plan, tmp_path / "base", workers=1, envs=1)
    found = diagnose_run(swap, twins_in=base)
    assert [t.key for t in found.trials if t.variation is None] == [
        "libero_object-00/base/0",
        "libero_object-01/base/0",
    ]
    gap = found.metric("illusion_gap", "overall")
    assert (gap.n, gap.value) == (2, 1.0)
    with pytest.raises(InvalidInputError, match=r"no counterfactual twin of the planned trials.*base suite"):
        diagnose_run(swap, twins_in=swap)
    page = write_report([found], tmp_path / "report", trust=trust_of([found])).read_text()
    assert ">pick up the cube and place it in the basket</a>" in page
    assert "objects stand at each other's places" in html.unescape(page)
    for ours in ("power matrix", "Pretenders", "fills a cell", "certificate"):
        assert ours not in page
    command = base_plan.world.command
    monkeypatch.setattr(Installation, "command", lambda _: command)
    shown = build_report([swap], tmp_path / "pair", twins=[base.path], latex=False, films=2).page.read_text()
    assert "not measured" not in shown
    assert shown.count("data:image/jpeg") >= 6


def test_a_run_of_a_base_suite_names_the_run_that_would_tell_more(plan_of, tmp_path):
    base = evaluate(plan_of("noop", suite="libero_object", steps=12), tmp_path / "base", workers=1, envs=1)
    found = diagnose_run(base)
    assert found.notes[-1].endswith(
        "run libero_object_swap with the same policy, and diagnose it with --twins and the run of its base suite."
    )
    told = []
    listener = ReportListener(say=told.append)
    built = build_report([base], tmp_path / "page", latex=False, films=2, listener=listener)
    told = " ".join(told)
    assert "No films: only trials of variations are filmed, but the 6 records belong to training conditions." in told
    assert "has a record" not in told
    (verdict,) = built.verdicts
    assert "run libero_object_swap with the same policy" in verdict
    assert "run libero_object_swap with the same policy" in html.unescape(built.page.read_text())
    swap = evaluate(plan_of("noop", trials=1, steps=12), tmp_path / "swap", workers=1, envs=1)
    assert not any("libero_object_swap" in note for note in diagnose_run(swap).notes)


@pytest.mark.parametrize(
    ("tasks", "told"),
    [
        (
            ["libero_object-03", "libero_10-00", "libero_object-01"],
            "run libero_object_swap and libero_10_swap with the ",
        ),
        (["libero_90-07"], ""),  # LIBERO-PRO does not change it
        ([], ""),
        (["fast_food"], ""),
    ],
)
def test_every_base_suite_has_its_own_next_run(tasks, told):
    trials = [SimpleNamespace(task=task, variation=None) for task in tasks]
    assert untold_by(trials).startswith(told)
    assert bool(untold_by(trials)) == bool(told)
    assert untold_by([*trials, SimpleNamespace(task="libero_object-03", variation="swap")]) == ""


def test_every_label_of_a_diagnosis_stands_in_the_table_of_the_documentation(still):
    page = (Path(__file__).parents[3] / "docs" / "worlds.md").read_text(encoding="utf-8")
    section = page.partition("## The diagnosis")[2]
    table = section.partition("| behavior | label |")[2].partition("\n\n")[0]
    listed = set(re.findall(r"\| `([a-z_]+)` \|$", table, flags=re.MULTILINE))
    never = set(re.findall(r"`([a-z_]+)`", re.search(r"((?:`[a-z_]+`,?\s(?:and\s)?)+)are never given", section)[1]))
    assert listed | never == {label.value for label in all_labels()}
    assert listed & never == set()
    # Why those are never given: there is something to do in every task, and no order is part of it.
    assert never == {"order_violation", "correct_freeze", "correct_refusal"}
    record = next(iter(still.records()))
    condition = libero._condition(record.metadata, libero._goals(record.metadata))
    assert (condition.expected, condition.instruction.ordered) == ("succeed", False)


def test_what_is_not_diagnosed_is_said(still):
    found = diagnose_run(still)
    assert any("harm to other objects is not judged" in note for note in found.notes)
    assert [t.label for t in found.trials] == ["early_halt"]


def test_the_regime_of_a_suite_says_which_word_stood_where(plan_of):
    trained = trained_in(plan_of("noop").world.regime)
    assert trained.word_slots == {"cube": ("x -12 y -24",), "ball": ("x 5 y -10",)}
    assert trained.standing_kinds["x -12 y -24"] == ("cube",)
    assert trained.kind_targets["ball"] == (("basket", "inside", ""),)


def test_a_plan_that_lost_its_regime_is_refused_with_a_cure(still, tmp_path):
    shutil.copytree(still.path, tmp_path / "run")
    rewrite(tmp_path / "run" / "run.json", lambda form: form["plan"]["world"].pop("regime"))
    with pytest.raises(RecordError, match=r"plan\.world.*regime.*Restore the file"):
        diagnose_run(tmp_path / "run")


@pytest.mark.parametrize(
    ("sentence", "word"),
    [
        ("pick up the black bowl on the ramekin and place it on the plate", "black bowl on the ramekin"),
        ("Pick the cream cheese and place it in the basket", "cream cheese"),
        ("put the wine bottle on top of the cabinet", "wine bottle, as a kind"),
    ],
)
def test_the_word_of_a_sentence_is_what_picks_the_object_out(sentence, word):
    assert word_of_sentence(sentence, "wine bottle, as a kind") == word
