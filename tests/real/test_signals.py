"""Signals of joint states: the same at every rate, in both units, with encoder noise, and with or without loads."""

import dataclasses

import numpy as np
import pytest
from tests.looping import each
from tests.real.joint_script import HOME, Script

from betterbench.errors import InvalidInputError
from betterbench.real.record import Samples
from betterbench.real.signals import Grip, JointTrack, signals_of, tool_path
from betterbench.sim.robots.spec import robot

SETTINGS = [
    {"rate_hz": rate_hz, "unit": unit, "noise": noise}
    for rate_hz in (15.0, 20.0, 30.0)
    for unit in ("degrees", "normalized")
    for noise in (None, 1)
]
each_setting = pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: "-".join(map(str, s.values())))


def test_forward_kinematics_are_those_of_the_twin():
    path = tool_path(np.radians(np.array([HOME, HOME])))
    assert path.shape == (2, 3)
    # 8 cm above the table and 20 cm in front of the base, as the robot's description says.
    np.testing.assert_allclose(path[0], (0.20, 0.0, 0.08), atol=1e-4)


@each_setting
def test_an_arm_that_stands_still_never_moves_however_long(setting):
    found = Script(**setting).wait(120.0).signals()
    assert not found.moved
    assert found.freeze.start_s <= 0.5
    assert found.freeze.end_s == pytest.approx(120.0, abs=0.2)
    assert found.to_and_fro is None
    assert found.closings == ()
    assert found.path_m < 0.4  # what makes motion back and forth


@each_setting
def test_a_grasp_is_found_with_its_times_and_place(setting):
    script = Script(**setting).wait(1.0).turn(1.0, pan=30.0).grasp(hold_s=0.6).turn(1.0, pan=-60.0, command=27.0)
    found = script.wait(0.5, command=27.0).jaw(60.0).wait(1.0).signals()
    (closing,) = found.closings
    assert closing.grip is Grip.OBJECT
    assert closing.start_s == pytest.approx(2.0, abs=0.15)
    assert closing.end_s == pytest.approx(2.4, abs=0.15)
    assert closing.let_go_s == pytest.approx(4.5, abs=0.25)
    assert closing.carried_m == pytest.approx(2 * 0.155 * np.sin(np.radians(30.0)), abs=0.02)
    assert closing.lost_s is None
    assert found.moved


@each_setting
@each(
    "opening, command, grip",
    [(36.0, 27.0, Grip.OBJECT), (0.5, 0.0, Grip.NOTHING), (10.0, 9.5, Grip.NOTHING), (40.0, 40.0, Grip.PRESET)],
)
def test_the_jaw_tells_what_it_closed_on(setting, opening, command, grip):
    found = Script(**setting).wait(1.0).grasp(opening=opening, command=command).signals()
    assert [c.grip for c in found.closings] == [grip]
    assert found.load_known is False


@pytest.mark.parametrize(
    ("opening", "command", "load", "grip"),
    [
        (36.0, 27.0, 0.3, Grip.OBJECT),
        (36.0, 35.0, 0.3, Grip.OBJECT),  # the load shows it although the command is nearly reached
        (36.0, 27.0, 0.01, Grip.PRESET),  # a stalled servo presses on nothing
        (10.0, 9.0, 0.01, Grip.NOTHING),
        (0.5, 0.0, 0.4, Grip.NOTHING),  # the jaws press on each other
    ],
)
def test_a_known_load_decides_instead_of_the_command(opening, command, load, grip):
    found = Script(load=True).wait(1.0).grasp(opening=opening, command=command, load=load).signals()
    assert [c.grip for c in found.closings] == [grip]
    assert found.load_known


@each_setting
def test_an_object_that_slips_is_lost(setting):
    script = Script(**setting).wait(0.5).grasp().turn(0.5, pan=20.0, command=27.0)
    found = script.jaw(2.0, command=0.0, seconds=0.3).wait(1.0, command=0.0).signals()
    first = found.closings[0]
    assert first.grip is Grip.OBJECT
    assert first.lost_s == pytest.approx(2.7, abs=0.3)
    assert first.let_go_s is None


def test_a_trial_that_ends_while_the_jaw_closes_tells_nothing():
    found = Script().wait(1.0).jaw(45.0, command=0.0, seconds=0.2).signals()
    assert [c.grip for c in found.closings] == [Grip.UNKNOWN]
    assert found.attempts == ()


def test_closing_high_above_the_table_is_no_attempt():
    found = Script().turn(1.0, lift=-70.0).grasp(opening=0.5, command=0.0).signals()
    assert found.closings[0].z > 0.2
    assert found.attempts == ()


@each_setting
def test_motion_back_and_forth_is_found_and_a_way_is_not(setting):
    script = Script(**setting).wait(0.5)
    for _ in range(8):
        script.turn(0.7, pan=40.0).turn(0.7, pan=-40.0)
    found = script.signals()
    assert found.to_and_fro is not None
    assert found.to_and_fro.end_s == pytest.approx(found.duration_s, abs=0.01)
    assert found.freeze is None
    way = Script(**setting).wait(0.5).turn(6.0, pan=80.0).turn(6.0, pan=-80.0).signals()
    assert way.to_and_fro is None


@each_setting
def test_a_freeze_begins_where_the_arm_stops(setting):
    found = Script(**setting).wait(0.5).turn(1.5, pan=40.0).wait(6.0).signals()
    assert found.freeze.start_s == pytest.approx(2.0, abs=0.6)
    assert found.moved
    assert found.at_rest
    assert Script(**setting).turn(1.5, pan=40.0).wait(2.0).signals().freeze is None  # shorter than a halt


def test_a_jaw_that_still_works_has_not_halted():
    script = Script().wait(4.0)
    for _ in range(3):
        script.jaw(20.0, command=20.0).jaw(60.0)
    assert script.signals().freeze is None


@each_setting
def test_repeated_approaches_are_counted(setting):
    script = Script(**setting).wait(0.5)
    for _ in range(4):
        script.dip()
    found = script.signals().repeated
    assert found is not None
    assert found.count in (3, 4)  # the last rise may end below the start
    assert Script(**setting).dip().dip().signals().repeated is None


def test_the_unit_changes_no_signal():
    def script(unit):
        return (
            Script(unit=unit)
            .wait(1.0)
            .turn(1.0, pan=30.0)
            .grasp()
            .turn(1.0, pan=-50.0, command=27.0)
            .jaw(60.0)
            .wait(4.0)
        )

    first, second = (script(unit).signals() for unit in ("degrees", "normalized"))
    np.testing.assert_allclose(first.path, second.path, atol=1e-9)
    one, other = (dataclasses.replace(s, path=np.zeros(0)) for s in (first, second))
    assert repr(one.freeze) == repr(other.freeze)
    assert [c.grip for c in one.closings] == [c.grip for c in other.closings]
    assert one.reach_m == pytest.approx(other.reach_m)


def test_late_control_steps_move_no_signal():
    samples = Script(noise=3).wait(1.0).turn(1.0, pan=30.0).grasp().jaw(60.0).wait(4.0).samples()
    rng = np.random.default_rng(5)
    late = samples.time_s + rng.uniform(0.0, 0.02, len(samples))
    keep = np.flatnonzero(rng.random(len(samples)) > 0.1)  # a tenth of the steps did not happen at all
    keep[0], keep[-1] = 0, len(samples) - 1
    fields = {f.name: getattr(samples, f.name)[keep] for f in dataclasses.fields(Samples)}
    shaken = Samples(**{**fields, "time_s": late[keep]})
    even, odd = (signals_of(JointTrack.of(s, unit="degrees", rate_hz=20.0)) for s in (samples, shaken))
    assert [c.grip for c in odd.closings] == [c.grip for c in even.closings] == [Grip.OBJECT]
    assert odd.closings[0].start_s == pytest.approx(even.closings[0].start_s, abs=0.15)
    assert odd.freeze.start_s == pytest.approx(even.freeze.start_s, abs=0.6)


def test_a_record_without_rows_is_refused():
    empty = Script().wait(0.05).samples()
    with pytest.raises(InvalidInputError, match="has 1 rows, but signals need at least two"):
        JointTrack.of(empty, unit="degrees", rate_hz=20.0)


def test_no_object_of_the_basket_fits_into_a_shut_jaw():
    from betterbench.diagnosis.thresholds import JAW_GAP, JAW_SHUT

    width = robot("so101").jaw.width_at_share(JAW_SHUT / 100.0)
    assert width < 0.0354  # the height of the soap bar, the smallest side of all objects
    # The servo of the twin leads by 12 mm at most, so that its gap around an object is larger than the threshold.
    assert 100.0 * robot("so101").gripper_lead_m / 0.15 > JAW_GAP
