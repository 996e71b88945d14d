"""A scenario becomes a certified task, or is refused with what was tried; the same job gives the same bytes."""

from __future__ import annotations

import dataclasses
import functools
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from betterbench.certification.certificate import CLAUSES, Clause, TrialCertificate
from betterbench.certification.coverage import load_coverage
from betterbench.diagnosis.measures.power_matrix import PowerCell, PowerMatrix
from betterbench.errors import InvalidInputError
from betterbench.generation.building import attempts as attempts_module
from betterbench.generation.building import viewing
from betterbench.generation.building.job import build_suite
from betterbench.generation.building.proving import Proof
from betterbench.generation.building.result import BuildReport, Failure, Settings
from betterbench.generation.grammar import write_scenarios
from betterbench.generation.scenario import Scenario
from betterbench.json_form import seal_of
from betterbench.report.pages.build_page import write_build_page
from betterbench.sim.scenes import engine_version
from betterbench.tasks import SUITE_VERSION, Condition, Task, TrialId, get_task, read_suite_folder, task_names
from betterbench.tasks.demonstrated import Demonstrated, read_demonstrations
from betterbench.tasks.user_files import COMPANION_SUFFIX

pytestmark = pytest.mark.usefixtures("indexed_once")

Fails = Callable[[Task, str], bool]


def proven(fails: Fails, runs: list[str]) -> Callable[..., Proof]:
    """Makes a proof without a simulator, in which some conditions fail."""

    def prove(task: Task, seeds: int, demonstrations: int) -> Proof:
        runs.append(task.id)
        names = [*(c.name for c in task.training), *(v.name for v in task.variations)]
        trials = tuple(certificate(task, name, seed, fails(task, name)) for name in names for seed in range(seeds))
        measured = Demonstrated(SUITE_VERSION, engine_version(), task.version, demonstrations, (), ())
        return Proof(measured, trials)

    return prove


def failing(*names: str) -> Fails:
    """Makes conditions fail whose names begin with one of these."""
    return lambda _, name: name.startswith(names) if names else False


def certificate(task: Task, name: str, seed: int, failed: bool) -> TrialCertificate:
    clauses = {letter: Clause(not (failed and letter == "a"), "it slipped" if failed else "") for letter in CLAUSES}
    return TrialCertificate(task.id, name, name.startswith("train"), seed, clauses, 10, 100, 0.0, 0.0, 0.5, 1.0)


@pytest.fixture(autouse=True)
def in_view(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Returns names of conditions that the camera does not show; the other conditions are not drawn."""
    hidden: set[str] = set()

    def badly_framed(task: Task, conditions: tuple[Condition, ...], *, seeds: int) -> tuple[Failure, ...]:
        assert task.id in task_names()
        assert seeds == 2
        names = [c.name for c in conditions if c.name in hidden]
        return tuple(Failure(name, (0,), viewing.CLAUSE, viewing.MEANING, "cup is 9 px long") for name in names)

    monkeypatch.setattr(attempts_module, "badly_framed", badly_framed)
    return hidden


@pytest.fixture
def build(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., tuple[BuildReport, list[str]]]:
    def run(scenarios: list[Scenario], fails: Fails, *, out: str = "out") -> tuple[BuildReport, list[str]]:
        runs: list[str] = []
        monkeypatch.setattr(attempts_module, "prove", proven(fails, runs))
        return build_suite(scenarios, tmp_path / out, name="kitchen", settings=Settings(2, 4)), runs

    return run


@functools.cache
def packing() -> Scenario:
    return write_scenarios("loose_packing", 1, seed=0)[0]


@functools.cache
def arranging() -> Scenario:
    """Return a desk, whose pattern has several tables; a place setting has one."""
    return next(s for s in write_scenarios("patterned_arrangement", 9, seed=0) if "laptop" in s.instruction)


@functools.cache
def stacking() -> Scenario:
    return write_scenarios("recursive_stacking", 1, seed=0)[0]


def test_a_certified_task_is_part_of_a_suite_that_can_be_read(build, tmp_path: Path) -> None:
    built, _ = build([packing(), stacking()], failing())
    assert [r.certified for r in built.results] == [True, True]
    assert [len(r.attempts) for r in built.results] == [1, 1]
    assert built.suite is not None
    suite = read_suite_folder(built.suite)
    assert sorted(suite.tasks) == sorted(r.task_id for r in built.results)
    for task in suite.tasks:
        text = (built.suite / "tasks" / f"{task}{COMPANION_SUFFIX}").read_text()
        assert read_demonstrations(text, task).tasks[task].solved >= 4
    coverage = load_coverage(built.suite / "certificate.json")
    ids = [TrialId(r.task_id, "train1", seed) for r in built.results for seed in (0, 1)]
    versions = {r.task_id: 1 for r in built.results}
    assert coverage.gap(ids, suite=SUITE_VERSION, engine=engine_version(), tasks=versions) is None
    assert not set(suite.tasks) & set(task_names()), "building leaves the registry as it was"


def test_a_failing_variation_is_left_out_with_its_clause(build) -> None:
    built, _ = build([packing()], failing("L1"))
    (result,) = built.results
    assert result.certified
    assert [(f.condition, f.clause, f.seeds, f.text) for f in result.left_out] == [("L1", "a", (0, 1), "it slipped")]
    assert "L1" not in {v["name"] for v in result.task["variations"]}
    assert {t.condition for t in result.trials}.isdisjoint({"L1"})


def test_other_slots_are_tried_when_training_fails(build) -> None:
    seen: list[tuple[object, ...]] = []

    def fails(task: Task, name: str) -> bool:
        slots = (task.slots, tuple(sorted(task.training[0].layout.items())))
        if slots not in seen:
            seen.append(slots)
        return name == "train1" and seen.index(slots) == 0

    built, runs = build([arranging()], fails)
    (result,) = built.results
    assert result.certified
    assert [a.change for a in result.attempts] == ["as described", "other slots"]
    assert result.attempts[0].failures[0].condition == "train1"
    assert len(runs) == 2


def test_a_task_whose_training_is_not_in_view_is_refused_before_the_certificate(build, in_view: set[str]) -> None:
    in_view.add("train2")
    built, runs = build([arranging()], failing())
    (result,) = built.results
    assert not result.certified
    assert runs == []
    assert result.attempts[0].reason == "a training condition is not in view"
    assert [(f.condition, f.clause, f.text) for f in result.attempts[0].failures] == [
        ("train2", "view", "cup is 9 px long")
    ]
    assert "three times the demonstrations" not in {a.change for a in result.attempts}


def test_a_variation_that_is_not_in_view_is_left_out(build, in_view: set[str], tmp_path: Path) -> None:
    in_view.add("L1")
    built, _ = build([packing()], failing("R1"))
    (result,) = built.results
    assert result.certified
    assert [(f.condition, f.clause) for f in result.left_out] == [("R1", "a"), ("L1", "view")]
    assert {"L1", "R1"}.isdisjoint({v["name"] for v in result.task["variations"]})
    page = write_build_page(built, tmp_path / "suite.html", settings=Settings(2, 4), cards={}).read_text()
    assert "left out: L1, seed 0, clause (view), the front camera shows every object of the instruction" in page


def test_training_with_placed_objects_is_drawn_after_the_demonstrations(build, in_view: set[str], monkeypatch) -> None:
    """A plate that starts on another one stands as a demonstration left it."""
    shown: list[list[bool]] = []
    checked = attempts_module.badly_framed

    def badly_framed(task: Task, conditions: tuple[Condition, ...], *, seeds: int) -> tuple[Failure, ...]:
        shown.append([bool(c.preplaced) for c in conditions])
        return checked(task, conditions, seeds=seeds)

    monkeypatch.setattr(attempts_module, "badly_framed", badly_framed)
    built, _ = build([stacking()], failing())
    assert built.results[0].certified
    before, after = shown
    assert not any(before)
    training = built.results[0].task["training"]
    placed = [f"train{n}" for n, c in enumerate(training, start=1) if c["preplaced"]]
    assert placed
    assert sum(after) >= len(placed)

    in_view.add(placed[0])
    built, runs = build([stacking()], failing(), out="unseen")
    assert not built.results[0].certified
    assert runs
    assert built.results[0].attempts[0].reason == "a training condition is not in view"


@pytest.mark.render
def test_what_the_camera_shows_too_small_or_not_at_all_is_named() -> None:
    """Every seed is drawn."""
    task = get_task("fruit_lunch")
    assert viewing.badly_framed(task, task.training[:1], seeds=2) == ()
    slot = task.training[0].layout["apple"]
    moved = tuple(dataclasses.replace(s, x=0.45, y=-0.95) if s.name == slot else s for s in task.slots)
    conditions = (task.training[0], task.training[1], task.training[0])
    found = viewing.badly_framed(dataclasses.replace(task, slots=moved), conditions, seeds=2)
    assert [f.seeds for f in found] == [(0, 1), (0, 1), (0, 1)]
    assert all(f.clause == viewing.CLAUSE for f in found)
    assert "0% of apple is visible, expected at least 60%" in found[0].text
    assert "mm from the edge of the image, expected at least 8" in found[0].text
    objects = tuple(
        dataclasses.replace(o, category="block", color="red") if o.name == "apple" else o
        for o in task.training[0].objects
    )
    small = dataclasses.replace(task.training[0], objects=objects)
    (fault,) = viewing.badly_framed(task, [small], seeds=1)
    assert re.fullmatch(r"apple is (19|2[0-3]) px long in the image, expected at least 24", fault.text)


def test_more_demonstrations_are_measured_when_a_pose_is_outside_of_training(monkeypatch, tmp_path: Path) -> None:
    numbers: list[int] = []

    def prove(task: Task, seeds: int, demonstrations: int) -> Proof:
        numbers.append(demonstrations)
        proof = proven(failing(), [])(task, seeds, demonstrations)
        outside = proof.trials[0].clauses | {"b": Clause(len(numbers) > 1, "released 12 mm above")}
        return dataclasses.replace(
            proof, trials=(dataclasses.replace(proof.trials[0], clauses=outside), *proof.trials[1:])
        )

    monkeypatch.setattr(attempts_module, "prove", prove)
    (result,) = build_suite([packing()], tmp_path / "out", name="kitchen", settings=Settings(2, 4)).results
    assert result.certified
    assert result.attempts[-1].change == "three times the demonstrations"
    assert numbers == [4, 12]


def test_what_cannot_be_certified_is_refused_with_everything_that_was_tried(build, tmp_path: Path) -> None:
    built, _ = build([packing()], failing("train1"))
    (result,) = built.results
    assert not result.certified
    assert built.suite is None
    words = [change.words for change in attempts_module.CHANGES if change.demonstrations == 1]
    assert [a.change for a in result.attempts] == words
    assert all(a.reason for a in result.attempts)


def test_too_few_variations_are_no_task(build) -> None:
    built, _ = build([packing()], failing("L", "R", "T"))
    assert not built.results[0].certified
    assert "variations over" in built.results[0].attempts[0].reason


def test_an_unknown_object_is_refused_by_name(build) -> None:
    (group, items) = ("items", packing().groups["items"])
    strange = dataclasses.replace(items[0], asset_query="bowling ball", description="a bowling ball")
    scenario = dataclasses.replace(packing(), groups={**packing().groups, group: (strange, *items[1:])})
    built, runs = build([scenario], failing())
    assert not runs
    assert "no asset suits 'bowling ball'" in built.results[0].attempts[0].reason


@pytest.mark.parametrize("name", ["twice", "A", "train1"])
def test_objects_without_a_name_of_their_own_do_not_stop_the_other_scenarios(build, name: str) -> None:
    items = tuple(dataclasses.replace(o, instance_name=name) for o in packing().groups["items"])
    built, _ = build(
        [dataclasses.replace(packing(), groups={**packing().groups, "items": items}), stacking()], failing()
    )
    assert [r.certified for r in built.results] == [False, True]
    assert "is also the name of" in built.results[0].attempts[0].reason


def test_an_instruction_that_asks_for_another_goal_is_refused_without_an_attempt(build) -> None:
    false = dataclasses.replace(packing(), instruction="Put the apple on top of the lunchbox.")
    built, runs = build([false], failing())
    assert not runs
    assert "asks for 'on top of'" in built.results[0].attempts[0].reason


def test_an_object_with_the_name_of_a_slot_does_not_stop_the_other_scenarios(build) -> None:
    built, _ = build([packing()], failing())
    slot = built.results[0].task["slots"][0]["name"]
    first, *items = packing().groups["items"]
    named = (dataclasses.replace(first, instance_name=slot), *items)
    built, runs = build(
        [dataclasses.replace(packing(), groups={**packing().groups, "items": named}), stacking()], failing()
    )
    assert [r.certified for r in built.results] in ([False, True], [True, True])
    assert len(runs) == sum(r.certified for r in built.results)


def test_a_wrong_name_of_the_suite_is_refused_before_the_work(build, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="'My Suite' is not a valid name"):
        build_suite([packing()], tmp_path / "out", name="My Suite")
    assert not (tmp_path / "out").exists()


def test_the_same_job_gives_the_same_bytes_and_repeats_nothing(build, tmp_path: Path) -> None:
    first, runs = build([packing(), stacking()], failing())
    assert len(runs) == 2
    before = {p.relative_to(first.suite): p.read_bytes() for p in first.suite.rglob("*") if p.is_file()}
    again, runs = build([packing(), stacking()], failing())
    assert (again, runs) == (first, [])
    shutil.rmtree(tmp_path / "out")
    build([packing()], failing())  # interrupted after the first scenario
    resumed, runs = build([packing(), stacking()], failing())
    assert len(runs) == 1
    assert resumed == first
    assert {p.relative_to(first.suite): p.read_bytes() for p in first.suite.rglob("*") if p.is_file()} == before


@pytest.mark.parametrize("name", ["../../etc", "<b>Löwe</b>", "42", "fruit lunch", "a" * 500, "—"])
def test_names_of_scenarios_become_safe_names_of_tasks(build, name: str, tmp_path: Path) -> None:
    twice = [dataclasses.replace(packing(), name=name), dataclasses.replace(stacking(), name=name)]
    built, _ = build(twice, failing())
    ids = [r.task_id for r in built.results]
    assert len(set(ids)) == 2
    assert all(i.isidentifier() and i.isascii() and i == i.lower() and len(i) <= 43 for i in ids)
    assert not set(ids) & set(task_names())
    assert {p.name for p in (tmp_path / "out" / "built").iterdir()} == {f"{i}.json" for i in ids}


def test_a_damaged_result_is_named(build, tmp_path: Path) -> None:
    built, _ = build([packing()], failing())
    file = tmp_path / "out" / "built" / f"{built.results[0].task_id}.json"
    file.write_text("{")
    with pytest.raises(InvalidInputError, match=file.name):
        build([packing()], failing())


def test_a_changed_result_is_named_and_not_certified(build, tmp_path: Path) -> None:
    built, _ = build([packing()], failing("train1"))
    file = tmp_path / "out" / "built" / f"{built.results[0].task_id}.json"
    file.write_text(file.read_text().replace(packing().name, "Another title"))
    with pytest.raises(InvalidInputError, match=f"{file.name}.*changed.*Remove the file"):
        build([packing()], failing())


def test_a_result_of_another_version_is_made_again(build, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build([packing()], failing())
    file = next((tmp_path / "out" / "built").iterdir())
    form = {k: v for k, v in json.loads(file.read_text()).items() if k not in ("seal", "chosen")}
    form |= {"key": "of another version", "new_field": 1}
    file.write_text(json.dumps({**form, "seal": seal_of(form)}))
    again, runs = build([packing()], failing())
    assert len(runs) == 1
    assert again.results[0].certified


@pytest.mark.parametrize("certified", [True, False])
def test_no_text_of_a_scenario_is_markup_on_the_page_or_a_name_of_a_file(
    build, tmp_path: Path, certified: bool
) -> None:
    evil = """<script>alert("1")</script> {{ 7*7 }} '"><img src=x> ../../up $(id)"""
    items = packing().groups["items"]
    said = tuple(dataclasses.replace(o, description=f"{o.description} {evil}", tags=(evil,)) for o in items)
    if not certified:
        said = (dataclasses.replace(said[0], asset_query=evil), *said[1:])
    scenario = dataclasses.replace(
        packing(),
        name=evil,
        instruction=re.sub(r"\d", "", evil),
        context=evil,
        groups={**packing().groups, "items": said},
    )
    built, _ = build([scenario], failing())
    assert built.results[0].certified == certified
    settings = Settings(2, 4)
    page = write_build_page(built, tmp_path / "suite.html", settings=settings, cards={}).read_text()
    assert "<script" not in page
    assert "<img" not in page
    assert "49" not in page.split("<body>")[1]
    assert "&lt;script&gt;" in page
    files = [p for p in (tmp_path / "out").rglob("*") if "catalogue" not in p.parts]
    assert all(re.fullmatch(r"\.?[a-z0-9_.-]+", p.name) for p in files)
    for result in built.results:
        form = {key: value for key, value in (result.task or {}).items() if key not in ("description", "title")}
        assert not any(text in json.dumps(form) for text in ("<script", "{{", "$(", "../")), "patterns word the rest"


def test_a_variation_that_every_faulty_policy_solves_is_named_on_the_page(build, tmp_path: Path) -> None:
    """``zoo:halt`` fails each new combination, so its failure shows nothing about the variation."""
    built, _ = build([packing()], failing())
    (result,) = built.results
    blind, sharp = (result.task_id, "L1"), (result.task_id, "R1")
    solved, failed = PowerCell(1, 1, 1), PowerCell(0, 1, 0, wrong={"early_halt": 1}, failed={"early_halt": 1})
    cells = {
        "expert": {blind: solved, sharp: solved},
        "zoo:lexical": {blind: solved, sharp: failed},
        "zoo:halt": {blind: failed, sharp: failed},
    }
    power = PowerMatrix(cells, {blind: 0.5, sharp: 0.5}, {})
    page = write_build_page(built, tmp_path / "suite.html", settings=Settings(2, 4), cards={}, power=power).read_text()
    assert "L1 has no power: no faulty policy that was tried fails it, except zoo:halt" in page
    assert "R1 has no power" not in page
