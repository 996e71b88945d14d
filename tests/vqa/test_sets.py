"""Sets of questions: the same bytes whatever happens, answers that the records prove, nothing to be answered blind."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import contextmanager
from dataclasses import replace

import pyarrow.parquet as pq
import pytest
from tests.vqa.checker import check
from tests.vqa.small import OPTIONS, SIZE, small_run

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, RecordError, RunConflictError, UnknownNameError
from betterbench.evaluation.figures.views import ViewRenderer
from betterbench.json_form import sealed_form
from betterbench.tasks import TrialId
from betterbench.vqa.dataset import SetOptions, begun_set, make_set, purpose_of, read_set
from betterbench.vqa.question import Form

pytestmark = [pytest.mark.physics, pytest.mark.render]


def content(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


class Failing:
    """A source of images that breaks off after some of them, as Ctrl-C does."""

    def __init__(self, source, after):
        self.source, self.left = source, after

    def photo(self, *what):
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        return self.source.photo(*what)

    def stop(self):
        """The source is used by other tests too."""


def failing(photos, after):
    @contextmanager
    def opened():
        with photos() as source:
            yield Failing(source, after)

    return opened


def test_interrupted_and_resumed_sets_have_the_same_bytes(run, photos, made, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        make_set(run, tmp_path / "set", OPTIONS, open_photos=failing(photos, 6))
    assert not (tmp_path / "set" / "summary.json").exists()
    make_set(run, tmp_path / "set", OPTIONS, open_photos=photos)
    assert content(tmp_path / "set") == {k: v for k, v in content(made.path).items() if not k.startswith("descri")}


@pytest.mark.slow
def test_what_a_kill_left_half_written_neither_stops_the_next_command_nor_stays(made, tmp_path):
    plan = json.loads((made.path / "set.json").read_text())
    del plan["schema_version"], plan["seal"]  # added when the plan is written
    out = tmp_path / "set"
    out.mkdir()
    (out / ".set.json.abc.part").touch()
    with begun_set(out, plan) as done:
        assert not done
    assert not list(out.rglob("*.part"))
    (out / "images").mkdir()
    (out / "images" / ".image.jpg.abc.part").touch()
    with begun_set(out, plan):
        assert not list(out.rglob("*.part"))


@pytest.mark.slow
def test_a_set_does_not_depend_on_the_number_of_workers(run, made, tmp_path):
    def opened():
        return ViewRenderer(run, size=SIZE, quality="fast")

    make_set(run, tmp_path / "set", OPTIONS, open_photos=opened, workers=3)
    assert content(tmp_path / "set") == {k: v for k, v in content(made.path).items() if not k.startswith("descri")}


def test_a_complete_set_is_read_and_not_made_again(run, photos, made):
    def never():
        raise AssertionError("no image is needed")

    again = make_set(run, made.path, OPTIONS, open_photos=never)
    assert again.questions == made.questions == read_set(made.path).questions
    assert [b.to_json() for b in again.baselines] == [b.to_json() for b in made.baselines]


def test_a_set_says_which_records_it_is_about_and_is_of_no_other_run(run, photos, made, tmp_path):
    """A run that went on, or was played again under the same trial names, is another one."""
    assert made.records == read_set(made.path).records == {str(e.key): run.record_digest(e) for e in run.entries()}
    made.require_about(run)
    key, copy = next(iter(made.records)), tmp_path / "copy"
    copy.mkdir()
    for name in ("set.json", "summary.json", "questions.jsonl"):
        (copy / name).write_bytes((made.path / name).read_bytes())
    plan = json.loads((copy / "set.json").read_text())
    for change, said in (({key: "0" * 64}, f'{key} is "000'), ({}, f"{key} is absent in the folder")):
        told = {**plan, "records": {k: v for k, v in {**plan["records"], **change}.items() if change or k != key}}
        (copy / "set.json").write_text(json.dumps(sealed_form(told)))
        with pytest.raises(RunConflictError, match=said):
            make_set(run, copy, OPTIONS, open_photos=photos)
    (copy / "set.json").write_text(json.dumps(sealed_form({**plan, "records": {key: "0" * 64}})))
    with pytest.raises(InvalidInputError, match=f"record of {key} in .* is not the record from .*from this run"):
        read_set(copy).require_about(run)
    for wrong in ([], {key: 1}):
        (copy / "set.json").write_text(json.dumps(sealed_form({**plan, "records": wrong})))
        with pytest.raises(RecordError, match="not a mapping from trials to hashes"):
            read_set(copy)
    (copy / "set.json").unlink()  # as sets of older versions, which do not say
    read_set(copy).require_about(run)


def test_every_answer_is_derived_again_from_the_records(run, made):
    wrong, derived, open_ = check(run, made.path)
    assert not wrong
    assert derived >= 0.9 * len(made.questions), open_


def test_the_checker_notices_a_wrong_answer(run, made, tmp_path):
    lines = [json.loads(line) for line in (made.path / "questions.jsonl").read_text().splitlines()]
    task = lines[0]["betterbench"]["source"]["task"]
    of_task = (line for line in lines if line["betterbench"]["source"]["task"] == task)
    turned = [line for line in of_task if line["betterbench"]["form"] == "yes_no"][:10]
    for line in turned:
        q = line["betterbench"]
        q["answer"] = "No" if q["answer"] == "Yes" else "Yes"
    (tmp_path / "questions.jsonl").write_text("".join(json.dumps(line) + "\n" for line in turned))
    wrong, derived, _ = check(run, tmp_path)
    assert len(wrong) == derived > 0


def test_answers_come_equally_often_within_a_group(made):
    groups = {}
    for q in made.questions:
        if q.form not in (Form.BOX, Form.POINT):
            groups.setdefault(q.group, {}).setdefault(q.answer, []).append(q)
            if q.options:
                assert q.answer in q.options
                assert q.chance == 1 / len(q.options)
    assert groups
    for answers in groups.values():
        assert len(answers) > 1
        assert len({len(members) for members in answers.values()}) == 1


def test_no_phrasing_tells_the_answer(made):
    counts = {}
    for q in made.questions:
        if q.form not in (Form.BOX, Form.POINT) and "[" not in q.text:  # the box of a question is its own
            counts.setdefault((q.group, q.text), Counter())[q.answer] += 1
    several = {group for group, _ in counts}
    assert len(counts) > len(several)  # more than one phrasing of a group occurs
    answers = {group: {a for (g, _), found in counts.items() if g == group for a in found} for group in several}
    for (group, text), found in counts.items():
        assert set(found) == answers[group], text
        assert len(set(found.values())) == 1, text


def test_a_set_has_its_files_in_both_forms(made):
    lines = [json.loads(line) for line in (made.path / "questions.jsonl").read_text().splitlines()]
    assert [line["id"] for line in lines] == [q.id for q in made.questions]
    for line, q in zip(lines, made.questions, strict=True):
        human, model = line["conversations"]
        assert (human["from"], model["from"]) == ("human", "gpt")
        assert human["value"].startswith("<image>\n" + q.text)
        assert model["value"] == q.reply
        assert (made.path / line["image"]).is_file()
    table = pq.read_table(made.path / "questions.parquet").to_pylist()
    assert [row["answer"] for row in table] == [q.answer for q in made.questions]
    images = {p.relative_to(made.path).as_posix() for p in (made.path / "images").rglob("*.jpg")}
    assert images == {q.image for q in made.questions}
    assert made.purpose == "test"


def test_other_sets_and_damage_are_one_clear_line(run, photos, made, tmp_path):
    with pytest.raises(RunConflictError, match=r"set\.options\.seed is 0 in the folder but 1 in the request"):
        make_set(run, made.path, replace(OPTIONS, seed=1), open_photos=photos)
    (tmp_path / "other.txt").touch()
    with pytest.raises(RunConflictError, match="contains other files"):
        make_set(run, tmp_path, OPTIONS, open_photos=photos)
    with pytest.raises(UnknownNameError, match="of the run's finished trials 'cheeseburger'"):
        make_set(run, tmp_path / "new", SetOptions(tasks=("cheeseburger",)), open_photos=photos)
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("set.json", "summary.json", "questions.jsonl"):
        (copy / name).write_bytes((made.path / name).read_bytes())
    (copy / "questions.jsonl").write_bytes((copy / "questions.jsonl").read_bytes()[:-10])
    with pytest.raises(RecordError, match="was changed after it was written"):
        read_set(copy)
    with pytest.raises(RecordError, match="contains no complete question set"):
        read_set(tmp_path)


def test_seeds_of_demonstrations_and_of_trials_do_not_mix():
    trials = [TrialId("fast_food", "train1", seed) for seed in (3, 1_000_000)]
    assert [purpose_of([t]) for t in trials] == ["test", "training"]
    with pytest.raises(InvalidInputError, match="mixes demonstration seeds and evaluation seeds"):
        purpose_of(trials)


def test_the_verb_prints_the_baselines(made, capsys):
    assert main(["vqa", str(made.path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["questions"] == len(made.questions)
    assert {b["name"] for b in document["baselines"]} >= {"counting", "premise"}
    assert main(["vqa", str(made.path)]) == 0
    assert "blind" in capsys.readouterr().out
    assert main(["vqa"]) == 2
    assert "Pass the folder of a run or set" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--cameras", "frnt"], "Unknown camera 'frnt'. Did you mean 'front'"),
        (["--size", "0"], "--size: 0 is out of range"),
        (["--frames", "-1"], "--frames: -1 is out of range"),
        (["--questions", "-1"], "--questions: -1 is out of range"),
        (["--tasks", "cofee"], "Unknown task of the run's finished trials 'cofee'"),
    ],
)
def test_bad_options_leave_no_folder_behind(run, tmp_path, capsys, words, said):
    assert main(["vqa", str(run.path), "--out", str(tmp_path / "set"), *words]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "set").exists()


@pytest.mark.slow
def test_ten_thousand_answers_are_derived_again_and_nothing_is_answered_blind(tmp_path):
    """Three trials of every condition of the suite by the expert, as in the calibration of the diagnosis."""
    from betterbench.tasks import get_task, suite_tasks

    wanted = {t: tuple(v.name for v in get_task(t).variations) for t in suite_tasks("better60")}
    run = small_run("expert", tmp_path / "run", wanted)
    options = SetOptions(questions=10_000, frames=24, size=SIZE, quality="fast")
    made = make_set(
        run, tmp_path / "set", options, open_photos=lambda: ViewRenderer(run, size=SIZE, quality="fast"), workers=2
    )
    wrong, derived, _ = check(run, made.path)
    assert not wrong
    assert derived >= 0.9 * len(made.questions)
    assert all(b.excess_points <= 5.0 for b in made.baselines), [b.to_json() for b in made.baselines]
