"""Demonstrations: where they are measured, what of them is kept, and what scenes draw from it."""

from __future__ import annotations

import dataclasses
import math

import pytest
from tests.daily import others_slow

from betterbench.certification import demonstrations, measuring
from betterbench.certification.demonstrations import (
    DemonstratedPut,
    Demonstration,
    demonstrate,
    planned_demonstrations,
    summed_up,
)
from betterbench.certification.examine import examine_rest
from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.geometry import Pose, yaw_of
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.experts.skills import Skills
from betterbench.sim.scenes import Scene, engine_version
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import SUITE_VERSION, TargetRegion, all_tasks, get_task, stream
from betterbench.tasks.demonstrated import (
    Demonstrated,
    DemonstrationsFile,
    FinalPoses,
    FlatPose,
    Releases,
    demonstrated,
    measured_so_far,
    read_demonstrations,
)
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED
from betterbench.tasks.relations import RELATIONS, PlaceGoal

PREPLACED = [
    (t.id, c.name)
    for t in all_tasks()
    for c in (*t.training, *t.variations)
    if resolve_condition(t.id, c.name).condition.preplaced
]


def a_put(**changes) -> DemonstratedPut:
    fields = {
        "slot": "stand",
        "relation": "inside",
        "region": "",
        "level": 1,
        "height_mm": 7.0,
        "point_mm": (60, 0),
        "kind": "burger",
        "asset": "burger-brown#0",
        "target_kind": "box",
        "target_asset": "takeaway_box-brown#0",
        "pose": FlatPose(60.0, 0.5, 3.0),
    }
    return DemonstratedPut(**{**fields, **changes})


def a_demonstration(trial, problem="", **changes) -> Demonstration:
    return Demonstration(trial.task, trial.condition, trial.seed, problem, (a_put(**changes),))


def scene_of(task_id, name, seed) -> Scene:
    found = resolve_condition(task_id, name)
    return Scene(found.task, found.condition, seed=seed, action_space=EE_DELTA, quality=QUALITIES["fast"])


def test_demonstrations_have_seeds_of_their_own_and_share_the_conditions_evenly():
    for task in all_tasks():
        first, second = planned_demonstrations(task, 3 * len(task.training))
        seeds = [trial.seed for trial in (*first, *second)]
        assert sorted(seeds) == list(range(FIRST_DEMONSTRATION_SEED, FIRST_DEMONSTRATION_SEED + len(seeds)))
        names = [trial.condition for trial in (*first, *second)]
        assert all(names.count(c.name) == 3 for c in task.training)
        assert all(not task.train(trial.condition).preplaced for trial in first)
        assert all(task.train(trial.condition).preplaced for trial in second)
    assert FIRST_DEMONSTRATION_SEED == 1_000_000, "law 8 of the suite"


def test_what_is_kept_of_demonstrations():
    task = get_task("fast_food")
    trials = planned_demonstrations(task, 4)[0]
    found = summed_up(
        task,
        [
            a_demonstration(trials[0]),
            a_demonstration(trials[1], height_mm=7.4, point_mm=(-60, 1), asset="burger-brown#2"),
            a_demonstration(trials[2], height_mm=50.0, pose=FlatPose(0.0, 1.0, 2.0)),
            a_demonstration(trials[3], problem="not solved", height_mm=90.0),
        ],
    )
    assert (found.suite, found.engine, found.version) == (SUITE_VERSION, engine_version(), task.version)
    assert found.solved == 3
    assert found.releases == (Releases("stand", "inside", "", 1, (7.0, 50.0), ((-60, 1), (60, 0))),)
    assert [(p.asset, len(p.poses)) for p in found.final_poses] == [("burger-brown#0", 2), ("burger-brown#2", 1)]
    file = DemonstrationsFile({"fast_food": found})
    assert read_demonstrations(file.to_text(), "test") == file


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"suite": "0.9"}, "suite version 0.9"),
        ({"engine": "3.1.0"}, "MuJoCo 3.1"),
        ({"version": 99}, "version of fast_food 99"),
    ],
)
def test_measurements_under_other_versions_are_refused_with_the_cure(monkeypatch, change, told):
    task = get_task("fast_food")
    known = dataclasses.replace(demonstrated(task, engine=engine_version()), **change)
    monkeypatch.setattr("betterbench.tasks.demonstrated._packaged", lambda: DemonstrationsFile({task.id: known}))
    with pytest.raises(InvalidInputError, match=told) as error:
        demonstrated(task, engine=engine_version())
    assert "better certify --tasks fast_food --demonstrations 120 --write-package" in str(error.value)


def test_a_missing_measurement_stops_a_certification_before_its_first_trial(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("betterbench.tasks.demonstrated._packaged", lambda: DemonstrationsFile({}))
    status = main(["certify", "--tasks", "fast_food", "--trials", "1", "--out", str(tmp_path / "cert")])
    assert status == 2
    error = " ".join(capsys.readouterr().err.split())
    assert "demonstrations of fast_food have not been measured" in error
    assert "--demonstrations 120" in error
    assert (tmp_path / "cert" / "journal.jsonl").read_bytes() == b""


def test_a_scene_with_something_preplaced_says_what_is_missing(monkeypatch):
    monkeypatch.setattr("betterbench.tasks.demonstrated._packaged", lambda: DemonstrationsFile({}))
    with pytest.raises(InvalidInputError, match="have not been measured"):
        scene_of("fruit_lunch", "T1", 0)
    assert scene_of("fruit_lunch", "L1", 0).condition.name == "L1"


# -------------------------------------------------------------------------------------------------------------- running


@pytest.fixture
def faked(monkeypatch):
    """Measuring without a simulator; ``faked.seen`` are the trials, each with what was known before."""
    seen = []

    def fake(trial, so_far=None, *, robot):
        if len(seen) == fake.stop:
            raise KeyboardInterrupt
        seen.append((trial, so_far))
        return a_demonstration(trial)

    fake.seen, fake.stop = seen, None
    monkeypatch.setattr(measuring, "demonstrate", fake)
    return fake


def test_measuring_goes_on_where_it_was_stopped(faked, tmp_path):
    faked.stop = 3
    with pytest.raises(KeyboardInterrupt):
        measuring.measure(["fast_food"], tmp_path, number=6)
    faked.stop = None
    told = []
    found = measuring.measure(["fast_food"], tmp_path, number=6, on_progress=lambda p: told.append((p.done, p.planned)))
    assert len(faked.seen) == len({trial for trial, _ in faked.seen}) == 6
    assert told[0] == (3, 6)
    assert told[-1] == (6, 6)
    assert found["fast_food"].solved == 6


def test_what_begins_as_others_left_it_is_measured_after_them(faked, tmp_path):
    measuring.measure(["dinner_plates"], tmp_path, number=12)
    task = get_task("dinner_plates")
    late = [bool(task.train(trial.condition).preplaced) for trial, _ in faked.seen]
    assert late == sorted(late)
    assert all((so_far is not None) == is_late for (_, so_far), is_late in zip(faked.seen, late, strict=True))
    assert faked.seen[-1][1].solved == late.count(False)


def test_other_versions_need_another_folder(faked, tmp_path, monkeypatch):
    measuring.measure(["fast_food"], tmp_path, number=2)
    used = measuring.versions_in_use(["fast_food"])
    monkeypatch.setattr(measuring, "versions_in_use", lambda _, **_options: dataclasses.replace(used, engine="9.9"))
    with pytest.raises(RunConflictError, match="another folder"):
        measuring.measure(["fast_food"], tmp_path, number=2)


def test_too_few_demonstrations_are_refused(faked, tmp_path):
    with pytest.raises(InvalidInputError, match="5 demonstrations do not cover the 12 training conditions"):
        measuring.measure(["desk_meeting"], tmp_path, number=5)
    assert faked.seen == []


def test_measurements_of_the_suite_are_for_its_maintainers(faked, tmp_path, capsys):
    status = main(["certify", "--tasks", "fast_food", "--demonstrations", "2", "--out", str(tmp_path / "cert")])
    assert status == 2
    assert "--write-package" in capsys.readouterr().err
    assert faked.seen == []


def test_a_file_keeps_the_tasks_that_were_not_measured_anew(faked, tmp_path, monkeypatch):
    path = tmp_path / "mine.demonstrations.json"
    monkeypatch.setattr(measuring, "destination", lambda _: path)
    measuring.write_demonstrations(measuring.measure(["fast_food"], tmp_path / "a", number=2))
    measuring.write_demonstrations(measuring.measure(["fruit_lunch"], tmp_path / "b", number=2))
    assert set(read_demonstrations(path.read_text(), "mine").tasks) == {"fast_food", "fruit_lunch"}


# --------------------------------------------------------------------------------------------------------------- scenes


def test_equally_good_places_are_taken_in_any_order_and_others_in_turn(start):
    _, _, state = start("fast_food")
    goals = tuple(
        PlaceGoal(Pose((0.1 * i, 0.0, 0.007)), alike=alike)
        for i, alike in enumerate((0.1,) * 6 + (0.2,) * 3 + (None,) * 3)
    )

    def order(seed, trained=None):
        def choice(purpose):
            return stream("fast_food", seed, purpose)

        skills = Skills(planner=None, period_s=0.05, choice=choice, trained=lambda *_: trained)
        tried = skills.in_turn(state, "burger_1", goals, TargetRegion("box"), "inside")
        return [round(10.0 * g.pose.position[0]) for g in tried]

    found = [order(seed) for seed in range(60)]
    assert all((sorted(f[:6]), sorted(f[6:9]), f[9:]) == ([0, 1, 2, 3, 4, 5], [6, 7, 8], [9, 10, 11]) for f in found)
    assert {f[0] for f in found} == {0, 1, 2, 3, 4, 5}
    assert order(3) == order(3)
    x, y, _ = (1000.0 * v for v in state.pose("box").inverse().apply((0.7, 0.0, 0.007)))
    assert order(3, Releases("stand", "inside", "", 1, (7.0,), ((round(x), round(y)),)))[0] == 7
    assert order(3, Releases("stand", "inside", "", 1, (50.0,), ((round(x), round(y)),))) == order(3)


@pytest.mark.physics
@pytest.mark.parametrize(("task_id", "name"), others_slow(PREPLACED, 12), ids=[f"{t}/{n}" for t, n in PREPLACED])
def test_what_is_preplaced_stands_as_a_demonstration_left_it_at_rest_with_every_look(task_id, name):
    poses = set()
    for seed in range(10):
        scene = scene_of(task_id, name, seed)
        state = scene.reset()
        known = demonstrated(scene.task, engine=engine_version())
        for thing, place in scene.condition.preplaced.items():
            info, target = state.info.object(thing), state.info.object(place.target)
            relation = RELATIONS[scene.task.template.relation]
            assets = (info.asset, target.asset)
            left = known.final_poses_at(target.kind, relation.name, place.region, kind=info.kind, assets=assets)
            middle = state.pose(place.target) @ Pose(relation.middle(target, place.region))
            at = middle.inverse() @ state.pose(thing)
            (x, y, _), yaw = at.position, math.degrees(yaw_of(at.quaternion))
            off = min(math.dist((1000.0 * x, 1000.0 * y, yaw), pose) for pose in left)
            alone = [*scene.condition.preplaced.values()].count(place) == 1  # two in a container are moved apart
            assert off < (1.0 if alone else 40.0), "0.3 mm or degrees of contact depth and of settling"
            poses.add((thing, round(x, 4), round(y, 4), round(yaw, 1)))
        found = examine_rest(scene)
        assert found.clause.passed, f"seed {seed}: {found.clause.text}"
    assert len(poses) >= 5


@pytest.mark.physics
def test_a_demonstration_is_measured():
    task = get_task("morning_coffee")
    found = demonstrate(planned_demonstrations(task, 4)[0][0])
    assert found.problem == ""
    (put,) = found.puts
    assert (put.slot, put.relation, put.kind, put.target_kind) == ("machine", "on_ring", "red mug", "coffee machine")
    assert 12.0 < put.height_mm < 15.0
    known = demonstrated(task, engine=engine_version())
    assert any(abs(put.height_mm - h) < 1.0 for r in known.releases for h in r.heights_mm)
    assert demonstrations.demonstrate(found.key) == found


def test_what_was_measured_so_far_decides_for_a_while():
    task = get_task("fast_food")
    before = demonstrated(task, engine=engine_version())
    mine = Demonstrated(
        "", "", 1, 0, (), (FinalPoses("a", "a#0", "b", "b#0", "inside", "", (FlatPose(0.0, 0.0, 0.0),)),)
    )
    with measured_so_far(task.id, mine):
        assert demonstrated(task, engine="9.9.9") is mine
    assert demonstrated(task, engine=engine_version()) is before
