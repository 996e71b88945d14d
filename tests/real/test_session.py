"""A session with an operator: nothing starts unasked, nothing is lost, and every way out leaves a still arm."""

import threading
from pathlib import Path

import pytest

from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.real.plan import RealPolicy, make_plan, write_plan
from betterbench.real.record import read_run
from betterbench.real.robots.mock import MockFaults, MockRobot
from betterbench.real.session import Command, RealSession, Stage

SCRIPTED = f"python:{Path(__file__).parent / 'scripted.py'}:Reach"
pytestmark = [pytest.mark.render, pytest.mark.physics]
SIZE = (160, 120)


@pytest.fixture
def folder(tmp_path):
    policies = (RealPolicy("a", SCRIPTED), RealPolicy("b", f"{SCRIPTED}?amount=-8.0"))
    write_plan(tmp_path, make_plan(policies, conditions=["O1"], time_limit_s=1.0))
    return tmp_path


def session_on(folder, *, faults=None):
    robot = MockRobot(read_run(folder).plan, faults=faults, cameras=("front",), size=SIZE)
    return RealSession(folder, robot, person="ada", apart=False, size=SIZE)


def obey(session, *names):
    for name in names:
        command, _, value = name.partition(" ")
        session.obey(Command(command, value))
    return session.view


def test_a_whole_plan_is_run_and_entered_in_its_order(folder):
    with session_on(folder) as session:
        session.begin()
        assert session.view.stage is Stage.SETUP
        assert obey(session, "arm", "start").stage is Stage.ENTER
        assert not session.view.armed
        assert obey(session, "enter froze").stage is Stage.SETUP
        assert obey(session, "arm", "start", "enter done").stage is Stage.DONE
        assert session.view.message == "Every trial is done."
    run = read_run(folder)
    assert [t.code for t in run.trials] == [t.code for t in run.plan.trials]
    assert [t.seen_by("operator")[0].decision.outcome for t in run.trials] == ["froze", "done"]
    assert all(t.header.agreement > 0.85 and not t.header.overridden for t in run.trials)
    amounts = {t.planned.policy: t.samples().command[-1, 0] - t.samples().command[0, 0] for t in run.trials}
    assert amounts["a"] > 2.0 > -2.0 > amounts["b"]


def test_nothing_starts_without_the_switch_or_on_a_wrong_scene_unless_it_is_forced(folder):
    with session_on(folder, faults=MockFaults(moved={"lemon": (0.03, 0.0)})) as session:
        session.begin()
        assert "Turn its switch on" in obey(session, "start").message
        view = obey(session, "arm", "start")
        assert "does not match the twin. The lemon lies" in view.message
        assert "too far from the arm" in view.message
        assert session._robot.commands == []
        assert obey(session, "force").stage is Stage.ENTER
    (trial,) = read_run(folder).trials
    assert trial.header.overridden
    assert trial.header.agreement < 0.6


def test_a_stopped_trial_comes_again_and_commands_that_waited_are_dropped(folder):
    with session_on(folder) as session:
        session.begin()
        stopped, seen = threading.Event(), []

        def stop_early():
            while len(session._robot.commands) < 5:
                stopped.wait(0.02)
            session.put(Command("arm"))
            session.put(Command("force"))
            session.halt()
            seen.append(len(session._robot.commands))
            stopped.wait(1.0)
            stopped.set()

        session.put(Command("arm"))
        session.put(Command("force"))
        threading.Thread(target=stop_early).start()
        session.run(stopped)
        assert session.view.stage is Stage.SETUP
        assert not session.view.armed
        assert len(session._robot.commands) == seen[0]
    run = read_run(folder)
    assert run.trials == ()
    (event,) = run.aborted
    assert event.reason == "the operator stopped it"
    assert (folder / "aborted" / f"{event.code}-1" / "samples.parquet").exists()


def test_switching_off_stops_a_running_trial_and_nothing_waits_to_switch_it_on(folder):
    with session_on(folder) as session:
        session.begin()

        def switch():
            while len(session._robot.commands) < 5:
                threading.Event().wait(0.02)
            session.put(Command("arm"))
            session.put(Command("force"))
            session.put(Command("disarm"))

        thread = threading.Thread(target=switch)
        thread.start()
        view = obey(session, "arm", "force")
        thread.join()
        assert (view.stage, view.armed) == (Stage.SETUP, False)
        assert "will be repeated: the operator switched it off" in view.message
        assert session._commands.empty()


def test_the_operator_ends_a_trial_that_is_over(folder):
    with session_on(folder) as session:
        session.begin()

        def over():
            while len(session._robot.commands) < 5:
                threading.Event().wait(0.02)
            session.put(Command("end"))

        threading.Thread(target=over).start()
        assert obey(session, "arm", "force").stage is Stage.ENTER
    assert read_run(folder).trials[0].header.ending == "operator"


def test_entries_are_taken_back_and_invalid_trials_repeated(folder):
    first = read_run(folder).plan.trials[0].code
    with session_on(folder) as session:
        session.begin()
        assert "has no effect in this stage" in obey(session, "enter froze").message
        view = obey(session, "arm", "start", "enter froze")
        assert view.can_undo
        view = obey(session, "undo")
        assert (view.stage, view.code, view.can_undo) == (Stage.ENTER, first, False)
        assert "needs a note" in obey(session, "enter other").message
        assert "needs a reason" in obey(session, "again").message
        session.obey(Command("enter", "invalid", "the lamp fell"))
        assert (session.view.stage, session.view.code) == (Stage.SETUP, first)
    run = read_run(folder)
    assert [(e.event, e.code, e.reason) for e in run.aborted] == [("repeated", first, "the lamp fell")]
    assert run.states[first].state == "open"


def test_a_trial_without_an_entry_is_asked_for_at_the_next_start(folder):
    with session_on(folder) as session:
        session.begin()
        code = obey(session, "arm", "start").code
    with session_on(folder) as session:
        session.begin()
        assert (session.view.stage, session.view.code) == (Stage.ENTER, code)
        obey(session, "enter missed")
    assert read_run(folder).trial(code).entries[0].decision.outcome == "missed"


def test_a_fault_is_told_and_the_trial_comes_again(folder):
    with session_on(folder, faults=MockFaults(broken=True, after_s=0.2)) as session:
        session.begin()
        view = obey(session, "arm", "start")
        assert (view.stage, view.armed) == (Stage.SETUP, False)
        assert "will be repeated: The bus of the arm does not answer" in view.message
    assert read_run(folder).trials == ()


def test_a_second_session_on_the_folder_is_refused_and_the_first_goes_on(folder):
    with session_on(folder) as session:
        with pytest.raises(RunConflictError, match="is writing here"):
            session_on(folder)
        with pytest.raises(InvalidInputError, match="'dance' is unknown"):
            session.put(Command("dance"))
    session_on(folder).close()


def test_the_view_names_neither_policy_nor_condition(folder):
    with session_on(folder) as session:
        session.begin()
        text = repr(session.view)
    assert "scripted" not in text
    assert "O1" not in text
    assert "policy" not in text


def test_a_page_never_sees_the_pictures_of_another_trial(folder):
    """The scene of the next trial takes seconds; until it is there, the page stays at the last one."""
    with session_on(folder) as session:
        session.begin()
        obey(session, "arm", "start")
        before = session.view
        seen = []
        steps = session._twin.steps

        def watched(trial):
            seen.append((session.view.code, session.view.stage, session.twin_view is not None))
            return steps(trial)

        session._twin.steps = watched
        obey(session, "enter froze")
        assert seen == [(before.code, Stage.ENTER, True)]
        assert session.view.code != before.code
        assert session.reading is None
        assert session.view.agreement is None


def test_a_film_that_cannot_be_encoded_makes_the_trial_come_again(folder, monkeypatch):
    """The session stayed in the running stage for ever, in which no key does anything."""
    from betterbench.demonstrations.export.video import VideoWriter

    def broken(self):
        raise RuntimeError("x264 has no memory")

    monkeypatch.setattr(VideoWriter, "finish", broken)
    with session_on(folder) as session:
        session.begin()
        view = obey(session, "arm", "start")
        assert (view.stage, view.armed) == (Stage.SETUP, False)
        assert "will be repeated: camera front: x264 has no memory" in view.message
        monkeypatch.undo()
        assert obey(session, "arm", "start").stage is Stage.ENTER
    run = read_run(folder)
    assert [t.header.attempt for t in run.trials] == [2]
    assert (folder / "aborted" / f"{run.trials[0].code}-1" / "samples.parquet").exists()


def test_a_full_disk_ends_the_session_with_a_still_arm_and_the_next_one_goes_on(folder, monkeypatch):
    import errno

    from betterbench.errors import StorageError
    from betterbench.jobs import durable

    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    with session_on(folder) as session:
        session.begin()
        session.obey(Command("arm"))
        monkeypatch.setattr(durable.os, "fsync", lambda handle: full(handle) if session._robot.commands else None)
        with pytest.raises(StorageError, match="No space left on device"):
            session.obey(Command("start"))
        assert not session._arm.is_armed
        monkeypatch.undo()
    with session_on(folder) as session:
        session.begin()
        assert "it will be repeated" in session.view.message
        assert obey(session, "arm", "start").stage is Stage.ENTER
    assert [t.header.attempt for t in read_run(folder).trials] == [2]


def test_a_trial_that_was_entered_as_not_valid_comes_again_after_a_kill_between_the_two_lines(folder, monkeypatch):
    from betterbench.real.record import RealJournal

    with session_on(folder) as session:
        session.begin()
        code = obey(session, "arm", "start").code
        monkeypatch.setattr(RealJournal, "repeat", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt()))
        with pytest.raises(KeyboardInterrupt):
            session.obey(Command("enter", "invalid", "the lamp fell"))
        monkeypatch.undo()
    with session_on(folder) as session:
        session.begin()
        assert (session.view.stage, session.view.code) == (Stage.SETUP, code)
    assert read_run(folder).aborted[0].reason == "the lamp fell"


def test_what_to_put_where_is_also_said_in_the_terminal(folder):
    """Without a page, nothing told the operator which scene to set up."""
    said = []
    robot = MockRobot(read_run(folder).plan, cameras=("front",), size=SIZE)
    with RealSession(folder, robot, person="ada", apart=False, size=SIZE, say=said.append) as session:
        session.begin()
        code, steps = session.view.code, session.view.steps
        assert session.view.message == ""
    (line,) = said
    assert line.startswith(f"{code}, trial 1 of 2: set up the scene. Tablecloth: ")
    assert all(step.text in line for step in steps)
