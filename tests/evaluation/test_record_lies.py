"""Records that lie: what follows from trial and actions is derived, and plan, journal and record have to agree."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from tests.daily import others_slow
from tests.evaluation.few_steps import in_few_steps
from tests.resealing import rewrite

from betterbench.cli.main import main
from betterbench.demonstrations.sets.sheet import draw_sheet
from betterbench.diagnosis import diagnose_run
from betterbench.errors import RecordError
from betterbench.evaluation import Progress, check_record, evaluate
from betterbench.evaluation.figures.films import Shot, render_shots, write_video
from betterbench.evaluation.figures.twin_film import render_paths
from betterbench.jobs.line_journal import link_after
from betterbench.json_form import dump_json
from betterbench.records import RunFolder, read_journal, read_record, write_record
from betterbench.records.modalities.spec import ViewSpec
from betterbench.records.scene_archive import scene_digest
from betterbench.sim.modalities.folder import Wanted
from betterbench.sim.modalities.run import materialize_run
from betterbench.sim.modalities.viewing import shown_rows
from betterbench.sim.scenes.limited import LimitedView
from betterbench.sim.scenes.stored import load_model, scene_files
from betterbench.tasks import TrialId
from betterbench.tasks.trial import Trial

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def genuine(uninterrupted):
    """A record of a short failure that ends at the step limit."""
    return read_record(uninterrupted.record_path("morning_coffee", "T1", 0))


@pytest.fixture
def copy(uninterrupted, tmp_path):
    shutil.copytree(uninterrupted.path, tmp_path / "copy")
    return RunFolder.open(tmp_path / "copy")


def meta(record, **changes):
    return dataclasses.replace(record, metadata=dataclasses.replace(record.metadata, **changes))


def outcome(record, **changes):
    return dataclasses.replace(record, outcome=dataclasses.replace(record.outcome, **changes))


def column(record, name, row, value):
    array = getattr(record, name).copy()
    array[row] = value
    return dataclasses.replace(record, **{name: array})


def shortened(record, rows):
    contacts = record.contacts
    kept = dataclasses.replace(
        contacts,
        offsets=contacts.offsets[: rows + 1].copy(),
        bodies=contacts.bodies[: contacts.offsets[rows]].copy(),
        forces=contacts.forces[: contacts.offsets[rows]].copy(),
    )
    bodies = record.bodies[: int(kept.bodies.max(initial=-1)) + 1]
    return dataclasses.replace(
        record, bodies=bodies, contacts=kept, **{n: a[:rows].copy() for n, a in record.arrays().items()}
    )


def flipped(record):
    other = not record.outcome.success
    return outcome(record, success=other, termination="success" if other else "step_limit")


def swapped_contact(record):
    forces = record.contacts.forces.copy()
    forces[0] += 1.0
    return dataclasses.replace(record, contacts=dataclasses.replace(record.contacts, forces=forces))


LIES = {
    "the verdict": (flipped, r"outcome\.termination"),
    "an error": (lambda r: outcome(r, success=False, termination="policy_error", error="no"), r"outcome\.termination"),
    "clipped actions": (lambda r: outcome(r, clipped_actions=10**6), r"outcome\.clipped_actions is 1000000"),
    "invalid actions": (lambda r: outcome(r, invalid_actions=3), r"outcome\.invalid_actions"),
    "an early end": (lambda r: shortened(r, 4), r"outcome\.termination"),
    "the instruction": (lambda r: meta(r, instruction="Do nothing"), r"metadata\.instruction is Do nothing"),
    "what is expected": (lambda r: meta(r, expected="refuse"), r"metadata\.expected"),
    "the axis": (lambda r: meta(r, axis="lexical"), r"metadata\.axis"),
    "the twin": (lambda r: meta(r, base_condition="train2"), r"metadata\.base_condition"),
    "the interventions": (lambda r: meta(r, interventions=()), r"metadata\.interventions"),
    "the room": (lambda r: meta(r, room="cellar"), r"metadata\.room"),
    "the scene": (lambda r: meta(r, scene_hash="0f" * 32), r"metadata\.scene_hash"),
    "the rate": (lambda r: meta(r, control_rate_hz=10.0), r"metadata\.control_rate_hz"),
    "the seed": (lambda r: meta(r, seed=3), r"metadata|qpos"),
    "the version of the task": (lambda r: meta(r, task_version=99), r"metadata\.task_version"),
    "the clock": (lambda r: column(r, "time", 3, 9.0), "time from row 3 on"),
    "the goal": (lambda r: column(r, "goal", -1, not r.goal[-1]), "goal from row"),
    "what is forbidden": (lambda r: column(r, "forbidden", 2, True), "forbidden from row 2 on"),
    "a subgoal": (lambda r: column(r, "subgoals", 1, ~r.subgoals[1]), "subgoals from row 1 on"),
    "what is held": (lambda r: column(r, "held", 5, 0), "held from row 5 on"),
    "an object": (lambda r: column(r, "object_positions", 2, 0.5), "object_positions from row 2 on"),
    "what was applied": (lambda r: column(r, "applied", 2, 0.25), "applied from row 2 on"),
    "a force": (swapped_contact, "contacts"),
}


@pytest.fixture
def quick(monkeypatch, genuine):
    """The genuine record cut to a few rows, in an episode that is as short: laws do not need its length."""
    from betterbench.evaluation.running import replay

    ordinary = replay.resolve_condition

    def few(task, condition):
        found = ordinary(task, condition)
        template = dataclasses.replace(found.task.template, base_steps=8, steps_per_subgoal=0, still_steps=8)
        return dataclasses.replace(found, task=dataclasses.replace(found.task, template=template))

    monkeypatch.setattr(replay, "resolve_condition", few)
    record = shortened(genuine, 9)
    clipped = int((record.applied[1:] != record.action[1:]).any(axis=1).sum())
    return outcome(record, success=False, termination="step_limit", error=None, clipped_actions=clipped)


def test_an_honest_record_follows_from_its_actions(quick, tmp_path):
    write_record(quick, tmp_path / "r.parquet")
    found = check_record(tmp_path / "r.parquet")
    assert found.identical, found.differing
    assert found.fields > 45


QUICK = ("the verdict", "an error", "clipped actions", "the instruction", "what is held", "a force")


@pytest.mark.parametrize(
    ("lie", "named"),
    [pytest.param(*lie, id=name, marks=() if name in QUICK else pytest.mark.slow) for name, lie in LIES.items()],
)
def test_whatever_a_record_says_falsely_is_named(quick, tmp_path, capsys, lie, named):
    write_record(lie(quick), tmp_path / "r.parquet")
    assert main(["replay", str(tmp_path / "r.parquet"), "--check", "--json"]) == 2
    said = capsys.readouterr()
    assert "the replay differs" in " ".join(said.err.split())
    found = json.loads(said.out)
    assert not found["identical"]
    assert any(re.search(named, text) for text in found["differing"]), found


def test_an_action_that_cannot_be_executed_is_one_line(quick, tmp_path):
    write_record(column(quick, "action", 3, np.nan), tmp_path / "r.parquet")
    with pytest.raises(RecordError, match="the recorded actions cannot be executed"):
        check_record(tmp_path / "r.parquet")


def test_a_record_resealed_in_its_run_is_refused_everywhere(copy, genuine, capsys):
    path = copy.record_path("morning_coffee", "T1", 0)
    write_record(flipped(genuine), path)
    for attempt in (
        lambda: check_record(path),
        lambda: list(copy.records()),
        lambda: copy.succeeded(copy.entries()[0].key),
        lambda: diagnose_run(copy),
    ):
        with pytest.raises(RecordError, match="is not the record that the journal lists"):
            attempt()
    assert main(["report", str(copy.path)]) == 2
    assert "is not the record that the journal lists" in capsys.readouterr().err.replace("\n", " ")


def test_records_of_another_policy_are_refused_also_with_their_journal(copy, tiny_plan):
    rewrite(copy.path / "run.json", lambda form: form["plan"].update(policy="zoo:lexical"))
    with pytest.raises(RecordError, match="its policy is 'random' but the run plans 'zoo:lexical'"):
        diagnose_run(copy.path)


@pytest.mark.parametrize("change", ["seed", "variation"])
def test_a_journal_of_another_plan_is_refused(copy, change):
    other = {change: 99 if change == "seed" else "L1"}
    rewrite(copy.path / "run.json", lambda form: form["plan"]["trials"][2].update(other))
    run = RunFolder.open(copy.path)
    for attempt in (run.entries, run.journal, lambda: diagnose_run(run)):
        with pytest.raises(RecordError, match="is not planned"):
            attempt()


def test_a_second_result_under_the_name_of_another_condition_is_refused(copy):
    lines = [json.loads(line) for line in copy.journal_path.read_text().splitlines()]
    form = {**next(line for line in lines if line["variation"]), "condition": "train1"}
    del form["link"]
    last = {**form, "link": link_after(lines[-1]["link"], form)}
    with copy.journal_path.open("ab") as journal:
        journal.write(dump_json(last) + b"\n")
    with pytest.raises(RecordError, match="train1/0 is a second result of"):
        RunFolder.open(copy.path).entries()


def without_link(line):
    return json.dumps({name: value for name, value in json.loads(line).items() if name != "link"})


CHANGES = {
    "a line left out": lambda lines: [lines[0], *lines[2:]],
    "two lines swapped": lambda lines: [lines[1], lines[0], *lines[2:]],
    "a figure changed": lambda lines: [lines[0].replace('"worker":', '"worker":1'), *lines[1:]],
    "a record changed": lambda lines: [lines[0], lines[1].replace('"record":"', '"record":"0')[:-1], *lines[2:]],
    "a link taken out": lambda lines: [
        lines[0],
        json.dumps({k: v for k, v in json.loads(lines[1]).items() if k != "link"}),
    ],
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_a_journal_that_was_changed_is_noticed(copy, tiny_plan, change):
    lines = copy.journal_path.read_text(encoding="utf-8").splitlines()
    copy.journal_path.write_text("".join(f"{line}\n" for line in change(lines)), encoding="utf-8")
    for attempt in (lambda: read_journal(copy.journal_path), lambda: evaluate(tiny_plan(), copy.path)):
        with pytest.raises(RecordError, match=r"journal\.jsonl: line \d (does not match|is corrupt)") as raised:
            attempt()
        assert "elete" not in str(raised.value)


@pytest.mark.usefixtures("steps_short")
def test_a_journal_of_an_older_version_is_read_and_continued(copy, tiny_plan):
    old = []
    for line in copy.journal_path.read_text(encoding="utf-8").splitlines()[:2]:
        form = json.loads(line)
        del form["link"], form["record"], form["scene"]
        old.append(f"{json.dumps(form)}\n")
    copy.journal_path.write_text("".join(old), encoding="utf-8")
    run = evaluate(tiny_plan(), copy.path)
    assert len(read_journal(run.journal_path)) == 4
    assert [e.record is None for e in run.entries()] == [True, True, False, False]


DAMAGES = {
    "missing": lambda path, _: path.unlink(),
    "empty": lambda path, _: path.write_bytes(b""),
    "cut": lambda path, _: path.write_bytes(path.read_bytes()[:-100]),
    "turned": lambda path, _: path.write_bytes(path.read_bytes().replace(b"T1", b"T2")),
    "another trial's": lambda path, other: shutil.copy(other, path),
    "a folder": lambda path, _: (path.unlink(), path.mkdir()),
    "a dangling link": lambda path, _: (path.unlink(), path.symlink_to("nowhere")),
    "a link to itself": lambda path, _: (path.unlink(), path.symlink_to(path.name)),
}


@pytest.fixture
def steps_short(monkeypatch):
    """Runs a lost trial again in a few steps, where its bytes do not matter."""
    monkeypatch.setattr(Trial, "resolve", in_few_steps(4))


@pytest.mark.parametrize(
    "damage",
    others_slow(DAMAGES.values(), 4),
    ids=DAMAGES.keys(),
)
@pytest.mark.usefixtures("steps_short")
def test_the_same_command_runs_a_lost_record_again(copy, tiny_plan, damage, caplog):
    path = copy.record_path("morning_coffee", "T1", 1)
    damage(path, copy.record_path("morning_coffee", "T1", 2))
    with pytest.raises(RecordError) as raised:
        list(copy.records())
    assert "Repeat the command of the run to record the trial" in str(raised.value)
    assert "elete" not in str(raised.value)
    told: list[Progress] = []
    run = evaluate(tiny_plan(), copy.path, on_progress=told.append)
    assert [p.last.seed for p in told[1:]] == [1]
    assert sorted(r.metadata.seed for r in run.records()) == [0, 1, 2, 3]
    assert "morning_coffee/T1/1 is run again" in caplog.text
    kept = [p.name for p in (copy.path / "set-aside").glob("*")]
    assert kept == ([] if damage is DAMAGES["missing"] else ["0-morning_coffee-T1-1.parquet"])
    assert len(evaluate(tiny_plan(), copy.path).entries()) == 4


@pytest.mark.usefixtures("steps_short")
def test_the_same_command_stores_a_damaged_scene_again(copy, tiny_plan):
    (scene,) = {r.metadata.scene_hash for r in copy.records() if r.metadata.seed == 1}
    copy.scene_path(scene).write_bytes(b"PK")
    with pytest.raises(RecordError, match=r"is damaged.*store it again"):
        copy.load_scene(scene)
    evaluate(tiny_plan(), copy.path)
    assert copy.load_scene(scene)


def exchanged(run, seed=0):
    """Exchanges the scene of a trial for another model, resealed, and returns its name and what was there."""
    name = run.read_record("morning_coffee", "T1", seed).metadata.scene_hash
    path = run.scene_path(name)
    whole, files = path.read_bytes(), run.load_scene(name)
    model = load_model(files)
    model.geom_rgba[:, :3] = model.geom_rgba[:, 2::-1]  # a red mug is blue
    path.unlink()
    run.store_scene(name, scene_files(model, name))
    run.load_scene(name)  # its own seal fits
    return name, whole


def test_the_journal_holds_the_digest_of_each_scene(copy):
    for entry in copy.entries():
        name = copy.read_record(entry.task, entry.condition, entry.seed).metadata.scene_hash
        assert entry.scene == scene_digest(name, copy.load_scene(name))


def test_an_exchanged_scene_with_its_seal_made_anew_is_refused_everywhere(copy, tmp_path, capsys):
    exchanged(copy)
    record = copy.read_record("morning_coffee", "T1", 0)
    trial = TrialId("morning_coffee", "T1", 0)
    views, out = (ViewSpec("front", 64, 64),), tmp_path / "out"
    with LimitedView(quality="fast") as limited:
        for attempt in (
            lambda: copy.scene_of(record.metadata),
            lambda: limited.open_of(copy, record),
            lambda: list(shown_rows(copy, record, views, quality="fast")),
            lambda: materialize_run(copy, out, Wanted(views, ("rgb",), "fast"), trials=(trial,)),
            lambda: render_shots(copy, (Shot("morning_coffee", "T1", 0, 0.0),)),
            lambda: render_paths(copy, (("morning_coffee", "T1", 0),)),
            lambda: write_video(copy, "morning_coffee", "T1", 0, out=tmp_path / "x.mp4", size=64),
            lambda: draw_sheet(copy, (trial,), tmp_path / "sheet.jpg"),
        ):
            with pytest.raises(RecordError, match=r"is not the scene of the trial.*store it again"):
                attempt()
    place = str(copy.record_path("morning_coffee", "T1", 0))
    for words in (
        ["view", place, "--out", str(tmp_path / "x.html")],
        ["materialize", str(copy.path), "--out", str(out), "--camera", "front:64", "--trial", "morning_coffee/T1/0"],
    ):
        assert main(words) == 2
        assert "is not the scene of the trial" in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.usefixtures("steps_short")
def test_the_same_command_stores_an_exchanged_scene_again(copy, tiny_plan, caplog):
    name, whole = exchanged(copy)
    run = evaluate(tiny_plan(), copy.path)
    assert "is run again" in caplog.text
    assert run.scene_path(name).read_bytes() == whole
    assert [p.name for p in (run.path / "set-aside").glob("*")] == [f"0-{name}.zip"]


@pytest.mark.usefixtures("steps_short")
def test_a_scene_that_somebody_put_there_before_is_not_taken_for_that_of_a_trial(copy, tiny_plan):
    name, whole = exchanged(copy)
    copy.journal_path.unlink()
    run = evaluate(tiny_plan(), copy.path)
    told = [e for e in run.entries() if run.scene_path(name).name in (e.message or "")]
    assert told
    assert all(e.status == "error" and "is not the scene of this trial" in e.message for e in told)
    run.scene_path(name).unlink()
    run = evaluate(tiny_plan(), copy.path)
    assert {e.status for e in run.entries()} == {"done"}
    assert run.scene_path(name).read_bytes() == whole


@pytest.mark.usefixtures("steps_short")
def test_a_damaged_scene_of_no_trial_is_stored_again(copy, tiny_plan):
    name = copy.read_record("morning_coffee", "T1", 0).metadata.scene_hash
    whole = copy.scene_path(name).read_bytes()
    copy.scene_path(name).write_bytes(whole[:-1000])
    copy.journal_path.unlink()
    run = evaluate(tiny_plan(), copy.path)
    assert {e.status for e in run.entries()} == {"done"}
    assert run.scene_path(name).read_bytes() == whole


def without_scenes(path):
    """Makes the journal of a run as a version wrote it that linked lines and knew no digests of scenes."""
    link, lines = "", []
    for line in path.read_text(encoding="utf-8").splitlines():
        form = {name: value for name, value in json.loads(line).items() if name not in ("link", "scene")}
        link = link_after(link, form)
        lines.append(dump_json({**form, "link": link}) + b"\n")
    path.write_bytes(b"".join(lines))


def test_a_run_of_a_version_without_digests_of_scenes_is_read_and_says_so_once(copy, tiny_plan, caplog):
    without_scenes(copy.journal_path)
    records = list(copy.records())
    for record in records:
        assert copy.scene_of(record.metadata)
    assert caplog.text.count("without scene digests") == 1
    assert len(evaluate(tiny_plan(), copy.path).entries()) == 4
    lines = copy.journal_path.read_text(encoding="utf-8").splitlines()
    lines[1] = lines[1].replace('"seed":1', '"seed":3')
    copy.journal_path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(RecordError, match="line 2"):
        copy.entries()


def test_a_digest_of_a_scene_is_not_taken_out_of_its_line(copy):
    lines = copy.journal_path.read_text(encoding="utf-8").splitlines()
    form = json.loads(lines[1])
    for change in ({"scene": None}, {"scene": "0" * 64}, {}):
        changed = {name: value for name, value in form.items() if name != "scene"} | change
        copy.journal_path.write_text("\n".join([lines[0], json.dumps(changed), *lines[2:]]) + "\n", encoding="utf-8")
        with pytest.raises(RecordError, match="line 2 does not match"):
            copy.entries()
