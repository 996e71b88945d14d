"""Folders of protocols for tests: trials of scripted joint states, and entries of people."""

import functools

from tests.real.joint_script import Script

from betterbench.jobs.decisions import now
from betterbench.real.plan import RealPolicy, make_plan, write_plan
from betterbench.real.record import (
    ENTRIES_NAME,
    Entry,
    EntryJournal,
    Film,
    RealJournal,
    Seen,
    TrialHeader,
    write_attempt,
)

POLICIES = (RealPolicy("first policy", "zoo:first"), RealPolicy("second policy", "zoo:second"))


@functools.cache
def still():
    return Script(noise=1).wait(12.0).samples()


@functools.cache
def packs():
    script = Script(noise=2).wait(0.5)
    script.turn(1.0, pan=15.0).grasp().turn(1.5, pan=-60.0, command=27.0).jaw(60.0)
    return script.turn(1.0, pan=45.0).wait(4.0).samples()


def header_of(code, attempt, steps, *, instruction, late_steps=0, films=None):
    return TrialHeader(
        1, code, attempt, "mock", instruction, "degrees", 20.0, "2026-11-29T10:00:00+00:00",
        "time_limit", steps, late_steps, 0, 0, films or {}, {},
    )  # fmt: skip


def protocol(folder, *, conditions=("train1", "T1", "T5"), moves=None, repeats=1, policies=POLICIES, late_frames=0):
    """Write a protocol of which all trials are done; ``moves(planned)`` returns samples, by default a packing arm."""
    plan = make_plan(policies, conditions=list(conditions), repeats=repeats)
    write_plan(folder, plan)
    with RealJournal(folder) as journal:
        for planned in plan.trials:
            samples = (moves or (lambda _: packs()))(planned)
            place = journal.begin(planned.code)
            steps = len(samples)
            films = {"front": Film(64, 48, steps, late_frames), "wrist": Film(64, 48, steps)}
            header = header_of(
                planned.code, 1, steps, instruction=plan.instruction(planned.condition), late_steps=2, films=films
            )
            write_attempt(place, header, samples, {camera: f"{camera} of {planned.code}".encode() for camera in films})
            journal.end(planned.code, "time_limit")
    return plan


def judge(folder, person, choose, *, role="judge"):
    """Enter ``choose(planned)`` for every trial of a plan."""
    from betterbench.real.plan import read_plan

    with EntryJournal(folder / ENTRIES_NAME) as journal:
        for planned in read_plan(folder).trials:
            outcome = choose(planned)
            if outcome is not None:
                journal.append(Entry(planned.code, 1, person, role, now(), Seen(outcome, "seen")))
