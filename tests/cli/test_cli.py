"""What people type and read: verbs, their help, their JSON, and errors that say what to do."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import shutil
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from tests.cli.helps import help_of
from tests.evaluation.conftest import in_few_steps
from tests.kept_views import used_by_commands
from tests.looping import each

from betterbench.cli.checks import Check
from betterbench.cli.main import every_command, main
from betterbench.errors import StorageError
from betterbench.records import RunFolder, read_record
from betterbench.sim.worlds.installation import Installation
from betterbench.tasks import TEMPLATES, all_tasks, get_task
from betterbench.tasks.authoring.registry import SUITES, registered_for_now
from betterbench.tasks.trial import Trial


def run(capsys, *arguments):
    try:
        status = main(arguments)
    except SystemExit as stop:
        status = stop.code or 0
    captured = capsys.readouterr()
    return status, captured.out, captured.err


BREAKS = """
from betterbench.policies import Noop

class Mine(Noop):
    def act(self, observation):
        raise KeyError("wrist")
"""


def test_a_run_in_which_every_trial_broke_is_no_success(capsys, tmp_path):
    (tmp_path / "mine.py").write_text(BREAKS, encoding="utf-8")
    arguments = ["--policy", f"python:{tmp_path / 'mine.py'}:Mine", "--tasks", "morning_coffee", "--variations", "T1"]
    arguments += ["--trials", "1", "--workers", "1", "--observation", "state_only", "--out", str(tmp_path / "run")]
    for last in ((), ("--json",)):
        status, out, err = run(capsys, "eval", *arguments, *last)
        assert status == 2
        said = " ".join(err.split())
        assert "failed with an error, so there is no result. morning_coffee/train1/0: KeyError: 'wrist' (" in said
        assert "mine.py, line 6, in act)" in said
    assert json.loads(out)["variations"] == {"k": 0, "n": 1}
    assert RunFolder.open(tmp_path / "run").entries()[0].status == "done"


@pytest.fixture(scope="module")
def small_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli") / "run"
    arguments = ["--policy", "zoo:lexical", "--tasks", "morning_coffee", "--variations", "L1", "T1", "--trials", "1"]
    assert main(["eval", *arguments, "--quality", "fast", "--workers", "1", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def brief_run(tmp_path_factory):
    """The trials of ``small_run`` without T1, ended after 3 s: a video of them has a tenth of the frames."""
    folder = tmp_path_factory.mktemp("cli") / "brief"
    arguments = ["--policy", "zoo:lexical", "--tasks", "morning_coffee", "--variations", "L1", "--trials", "1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trial, "resolve", in_few_steps(60))
        assert main(["eval", *arguments, "--quality", "fast", "--workers", "1", "--out", str(folder)]) == 0
    return folder


@each("verb", every_command())
def test_every_verb_has_help_with_an_example(verb):
    assert f"better {verb}" in help_of(verb)
    assert "Example" in help_of(verb)


def test_a_command_of_a_verb_has_its_own_options_only(capsys):
    _, imported, _ = run(capsys, "assets", "import", "--help")
    _, searched, _ = run(capsys, "assets", "search", "--help")
    assert "--mass-kg" in imported
    assert "--limit" not in imported
    assert "--limit" in searched
    assert "--mass-kg" not in searched
    status, _, err = run(capsys, "assets", "serch", "mug")
    assert status == 2
    assert "Unknown command of better assets 'serch'. Did you mean 'search'" in err


def test_options_may_precede_the_command_of_a_verb(capsys, tmp_path):
    folder = str(tmp_path / "none")
    before, after = (
        run(capsys, "assets", *words)
        for words in (["--catalogue", folder, "search", "mug"], ["search", "mug", "--catalogue", folder])
    )
    assert before == after
    assert before[0] == 2
    assert "has no asset catalogue" in before[2]


@each("verb", every_command())
def test_the_help_of_every_verb_is_read_at_80_columns(verb):
    out = help_of(verb)
    assert max(map(len, out.splitlines())) <= 80
    assert "None" not in out
    assert "(default: )" not in out


@pytest.mark.parametrize("what", ["suites", "tasks", "variations", "policies", "assets", "templates"])
def test_lists_are_json_on_request(capsys, what):
    status, out, _ = run(capsys, "list", what, "--json")
    listed = json.loads(out)
    assert status == 0
    assert listed


@pytest.mark.parametrize("what", ["suites", "tasks", "variations", "policies", "assets", "templates"])
def test_lists_are_read_at_80_columns(capsys, monkeypatch, what):
    """No line is wider, no row takes more than four lines, and nothing of a row is left out."""
    monkeypatch.setattr("betterbench.cli.console.OUT._width", 80)
    _, listed, _ = run(capsys, "list", what, "--json")
    rows = json.loads(listed)
    _, out, _ = run(capsys, "list", what)
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    names = [next(iter(row.values())) for row in rows]
    starts = [next(i for i, line in enumerate(lines) if line.split("  ")[0].strip() == name) for name in names]
    longest = {"tasks": 3, "variations": 3, "templates": 4}.get(what, 2)
    assert all(b - a <= longest for a, b in itertools.pairwise(starts)), out
    words = set(re.split(r"[\s,.:]+", out))
    for row in rows:
        for name, value in row.items():
            if name not in ("axis", "installed"):
                assert set(re.split(r"[\s,.:]+", value)) <= words | {""}, value


@pytest.mark.parametrize("installed", [False, True])
def test_suites_say_which_worlds_are_not_installed(capsys, monkeypatch, installed):
    """The list is as narrow where nothing is installed, as on a new machine."""
    monkeypatch.setattr("betterbench.cli.console.OUT._width", 80)
    monkeypatch.setattr(Installation, "is_installed", installed)
    _, listed, _ = run(capsys, "list", "suites", "--json")
    state = {row["suite"]: row["installed"] for row in json.loads(listed)}
    assert {state.pop(suite) for suite in SUITES} == {"yes"}
    assert set(state.values()) == {"yes" if installed else "no"}
    _, out, _ = run(capsys, "list", "suites")
    said = r"\nnot installed here: calvin, libero, libero_plus. To install one:\n\S+ worlds install calvin\n"
    assert bool(re.search(said, out)) is not installed
    assert len(out.splitlines()) <= 2 * len(state) + 6


def test_templates_of_different_tasks_are_all_listed_even_with_one_name(capsys):
    lunch = get_task("fruit_lunch")
    packed = replace(lunch.template, name="packed")
    slower = replace(packed, groups=tuple(replace(g, count_range=(0, 9)) for g in packed.groups))
    mine = [("lunch_1", packed), ("lunch_2", slower), ("lunch_3", replace(packed)), ("lunch_4", lunch.template)]
    mine += [("lunch_5", replace(slower, name=lunch.template.name))]
    with ExitStack() as stack:
        for name, template in mine:
            stack.enter_context(registered_for_now(replace(lunch, id=name, template=template)))
        _, out, _ = run(capsys, "list", "templates", "--json")
    listed = [(row["template"], row["tasks"]) for row in json.loads(out)]
    assert listed[-3:] == [("packed", "lunch_1, lunch_3"), ("packed", "lunch_2"), ("loose_packing", "lunch_5")]
    assert next(tasks for name, tasks in listed if name == "loose_packing").endswith("lunch_4, tidy_desk")
    assert len(listed) == len(TEMPLATES) + 3


def test_variations_are_counted_by_axis(capsys):
    _, out, _ = run(capsys, "list", "variations")
    total = sum(len(t.variations) for t in all_tasks())
    letters = [v.name[0] for t in all_tasks() for v in t.variations]
    counts = ", ".join(f"{letters.count(letter)} {letter}" for letter in "LROT")
    assert f"{total} variations: {counts}" in out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("eval", "--policy", "zoo:lexica"), "zoo:lexical"),
        (("eval", "--policy", "expert", "--tasks", "fast_fod"), "fast_food"),
        (("eval", "--policy", "expert", "--suite", "better06"), "better60"),
        (("eval", "--policy", "expert", "--suite", "better06", "--tasks", "fast_food"), "Did you mean 'better60'"),
        (("certify", "--suite", "better06", "--tasks", "fast_food"), "Did you mean 'better60'"),
        (("eval", "--policy", "expert", "--replicas", "1"), "--replicas: this option is for Ray clusters"),
        (("eval", "--policy", "expert", "--replica-gpus", "0.5"), "--replica-gpus: this option is for Ray clusters"),
        (("eval", "--policy", "expert", "--ray-address", "auto"), "or leave out --ray-address"),
        (("eval", "--policy", "expert", "--allow-other-versions"), "Add --from RUN"),
        (("eval", "--policy", "expert", "--variations", "X9"), "X9"),
        (("eval", "--policy", "replay:nowhere"), "no run"),
        (("serve", "replay:x:runs"), "replay:x:runs"),
        (("eval", "--policy", "openpi://127.0.0.1:1?patience=0.1&preset=native"), "127.0.0.1:1"),
        (("eval", "--policy", "openpi://127.0.0.1:1?patiense=1"), "patience"),
        (("eval", "--policy", "opnpi://127.0.0.1:1"), "Did you mean 'openpi'"),
        (("eval", "--policy", "expert", "--trials", "0"), "--trials"),
        (("eval", "--policy", "expert", "--quality", "fastest"), "fast"),
        (("show", "fast_food/T9"), "T1"),
        (("diagnose", "no/such/run"), "no run"),
        (("report", "no/such/run"), "no run"),
        (("report",), "runs: no run was given"),
        (("compare",), "Pass at least two"),
        (("eval", "--policy", "expert", "--out", ""), "--out: the folder name is empty"),
        (("eval", "--policy", "expert", "--out="), "--out: the folder name is empty"),
        (("export",), "runs: no run was given"),
        (("export", "--check", "set"), "the folders of the runs to compare with set"),
        (("replay", "no/such/record.parquet", "--check"), "record.parquet"),
    ],
)
def test_bad_input_is_one_clear_error_with_status_2(capsys, monkeypatch, tmp_path, arguments, text):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *arguments)
    assert status == 2
    assert not out
    assert "error:" in err
    assert text in err.replace("\n", " ")
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_diagnose_json_has_the_promised_fields(capsys, small_run):
    status, out, _ = run(capsys, "diagnose", str(small_run), "--json")
    document = json.loads(out)
    assert status == 0
    fields = {"task", "variation", "condition", "axis", "seed", "policy", "success", "expected", "label", "kind"}
    fields |= {"first_attempt", "intended", "progress", "evidence"}
    planned = json.loads((small_run / "run.json").read_text())["plan"]["trials"]
    assert len(document["trials"]) == len(planned)
    for trial in document["trials"]:
        assert fields <= set(trial)
        assert trial["policy"] == "zoo:lexical"
        assert trial["kind"] in {"none", "reasoning", "execution", "system"}
    assert {"k", "n", "value", "low", "high"} <= set(document["metrics"][0])
    by_name = {t["variation"]: t for t in document["trials"] if t["variation"]}
    assert by_name["L1"]["label"] == "success"
    assert by_name["T1"]["label"] == "behavioral_inertia"
    assert by_name["T1"]["expected"] == "stay_still"


def test_a_diagnosis_tells_how_far_it_is(small_run):
    from betterbench.comparison import submission_of
    from betterbench.diagnosis import diagnose_run

    count = len(json.loads((small_run / "run.json").read_text())["plan"]["trials"])
    told, of_submission = [], []
    diagnose_run(small_run, on_progress=lambda *numbers: told.append(numbers))
    submission_of(RunFolder.open(small_run), on_progress=lambda *numbers: of_submission.append(numbers))
    assert told == of_submission == [(i, count) for i in range(count)]


def test_a_submission_of_a_run_is_compared_as_the_run_is(capsys, small_run, tmp_path):
    out = tmp_path / "lexical.json"
    assert run(capsys, "export", str(small_run), "--out", str(out))[0] == 0
    assert run(capsys, "export", str(small_run), "--check", str(out))[0] == 0
    status, text, _ = run(capsys, "compare", str(small_run), str(out), "--json")
    document = json.loads(text)
    assert status == 0
    assert document["notes"] == []
    assert document["power"][0] == document["power"][1]
    for group in document["groups"]:
        first, second = group["sides"]
        assert first["rate"] == second["rate"]
    held = json.loads(out.read_text())
    planned = json.loads((small_run / "run.json").read_text())["plan"]["trials"]
    assert len(held["trials"]) == len(planned)
    record = small_run / "records" / "morning_coffee" / "T1" / "0.parquet"
    hashes = {t["condition"]: t["record_sha256"] for t in held["trials"]}
    assert hashes["T1"] == hashlib.sha256(record.read_bytes()).hexdigest()


def test_tensorboard_gets_every_metric_with_its_interval(capsys, small_run, tmp_path):
    pytest.importorskip("tensorboardX")
    from betterbench.cli.trackers import tracked_numbers
    from betterbench.diagnosis import diagnose_run

    out = tmp_path / "events"
    status, _, _ = run(capsys, "export", str(small_run), "--to", "tensorboard", "--out", str(out))
    assert status == 0
    (events,) = out.iterdir()
    data = events.read_bytes()
    numbers = tracked_numbers(diagnose_run(small_run))
    assert {"success_rate/overall", "success_rate/overall/low", "labels/success"} <= set(numbers)
    for key in numbers:
        assert key.encode() in data


@pytest.mark.parametrize("extra", ["tensorboard", "wandb"])
def test_a_missing_tracker_is_one_line_with_the_extra(capsys, monkeypatch, small_run, tmp_path, extra):
    package = {"tensorboard": "tensorboardX"}.get(extra, extra)
    for name in {package, *(name for name in sys.modules if name.startswith(f"{package}."))}:
        monkeypatch.setitem(sys.modules, name, None)
    status, _, err = run(capsys, "export", str(small_run), "--to", extra, "--out", str(tmp_path))
    assert status == 2
    assert f"setup EXTRAS={extra}" in " ".join(err.split())


@pytest.fixture
def fake_wandb(monkeypatch):
    """What wandb does with folders: a run makes one of its own in ``dir``, with a link to the latest."""
    made = SimpleNamespace(stops=False, logged=[])

    class Run:
        def __init__(self, place):
            self.place, self.summary = place, {}

        def __enter__(self):
            self.place.mkdir(parents=True)
            (self.place.parent / "latest-run").symlink_to(self.place.name)
            (self.place / "run-1.wandb").write_bytes(b"half")
            return self

        def log(self, values):
            if made.stops:
                raise KeyboardInterrupt
            made.logged.append((self.summary, values))
            (self.place / "run-1.wandb").write_bytes(b"whole")

        def __exit__(self, *_):
            pass

    module = ModuleType("wandb")
    module.setup = lambda: SimpleNamespace(settings=SimpleNamespace(mode="offline"))
    module.Settings = lambda **options: options
    module.Table = lambda **options: options
    module.teardown = lambda: None
    module.init = lambda **given: Run(Path(given["dir"]) / "wandb" / f"offline-run-{len(made.logged)}")
    monkeypatch.setitem(sys.modules, "wandb", module)
    return made


def test_wandb_gets_the_numbers_and_the_trials(capsys, small_run, tmp_path, fake_wandb):
    out = tmp_path / "a folder"
    for number in range(2):
        status, _, err = run(capsys, "export", str(small_run), "--to", "wandb", "--out", str(out))
        assert status == 0
        assert f"wandb sync '{out}/wandb/offline-run-{number}'" in err
    assert sorted(str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()) == [
        "wandb/offline-run-0/run-1.wandb",
        "wandb/offline-run-1/run-1.wandb",
    ]
    numbers, logged = fake_wandb.logged[0]
    assert numbers["success_rate/overall/n"] > 0
    assert len(logged["trials"]["data"]) == 4


def test_an_export_to_wandb_is_whole_or_not_there(capsys, small_run, tmp_path, fake_wandb, monkeypatch):
    """wandb ends well on a full disk, with a file that is cut short, and a run that was killed would be sent later."""
    from betterbench.cli import trackers
    from betterbench.jobs.durable import DurableFile

    words = ("export", str(small_run), "--to", "wandb", "--out", str(tmp_path))
    left = tmp_path / ".wandb-killed.part" / "wandb" / "offline-run-9"
    left.mkdir(parents=True)
    (tmp_path / ".wandb.abcd1234.part").write_bytes(bytes(9))
    fake_wandb.stops = True
    assert run(capsys, *words)[0] == 130
    assert not list(tmp_path.iterdir())
    fake_wandb.stops = False
    asked = []

    class FilledMeanwhile(DurableFile):
        def __init__(self, path):
            asked.append(path)
            if len(asked) == 2:
                raise StorageError(f"{path}: No space left on device.")
            super().__init__(path)

    monkeypatch.setattr(trackers, "DurableFile", FilledMeanwhile)
    status, _, err = run(capsys, *words)
    assert (status, len(asked)) == (2, 2)
    assert "No space left on device" in err
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


def test_wandb_follows_no_link_out_of_its_folder(capsys, small_run, tmp_path, fake_wandb):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    out.mkdir()
    elsewhere.mkdir()
    (out / "wandb").symlink_to(elsewhere)
    status, _, err = run(capsys, "export", str(small_run), "--to", "wandb", "--out", str(out))
    assert status == 2
    assert "is a symbolic link" in err
    assert not list(elsewhere.iterdir())
    assert not fake_wandb.logged


def test_the_same_command_again_runs_nothing(capsys, small_run):
    journal = (small_run / "journal.jsonl").read_bytes()
    arguments = ["--policy", "zoo:lexical", "--tasks", "morning_coffee", "--variations", "L1", "T1", "--trials", "1"]
    again = (*arguments, "--quality", "fast", "--workers", "1", "--out", str(small_run), "--json")
    status, out, _ = run(capsys, "eval", *again)
    assert status == 0
    assert json.loads(out)["variations"] == {"k": 1, "n": 2}
    assert (small_run / "journal.jsonl").read_bytes() == journal


def test_another_plan_in_the_same_folder_is_refused(capsys, small_run):
    status, _, err = run(capsys, "eval", "--policy", "noop", "--trials", "1", "--out", str(small_run))
    assert status == 2
    assert "plan" in err


@pytest.mark.parametrize("options", [(), ("--check",), ("--twin",)])
def test_nothing_that_is_no_record_is_called_damaged_or_to_be_deleted(capsys, small_run, tmp_path, options):
    (tmp_path / "thesis.parquet").write_bytes(b"years of work")
    for path in (small_run, small_run / "records", tmp_path / "thesis.parquet", tmp_path):
        status, out, err = run(capsys, "replay", str(path), *options)
        said = " ".join(err.split())
        assert status == 2
        assert not out
        assert "delete" not in said.lower()
        assert "RUN/records/TASK/CONDITION/SEED.parquet" in said or "morning_coffee" in said
        if path.is_dir():
            assert "is a folder" in said
            assert "damaged" not in said


@pytest.mark.parametrize("words", [["replay"], ["replay", "--check"], ["view"]], ids=" ".join)
def test_a_run_folder_instead_of_a_record_names_a_record(capsys, small_run, tmp_path, words):
    assert main([words[0], str(small_run), *words[1:]]) == 2
    said = " ".join(capsys.readouterr().err.split())
    found = re.fullmatch(r"error: (\S+): this is a folder of a run\. Pass one of its records, such as (\S+)\.", said)
    assert found is not None, said
    assert found[1] == str(small_run)
    assert Path(found[2]).is_file()
    (tmp_path / "run.json").write_text("{}")
    assert main([words[0], str(tmp_path), *words[1:]]) == 2
    assert "Pass one of its records, but this run has none yet." in " ".join(capsys.readouterr().err.split())


def test_replay_checks_bit_for_bit(capsys, small_run):
    record = small_run / "records" / "morning_coffee" / "L1" / "0.parquet"
    status, out, _ = run(capsys, "replay", str(record), "--check", "--json")
    assert status == 0
    assert json.loads(out)["identical"] is True


@pytest.mark.render
@pytest.mark.usefixtures("kept_views")
def test_a_record_becomes_a_video(capsys, brief_run, tmp_path):
    record = brief_run / "records" / "morning_coffee" / "L1" / "0.parquet"
    out = tmp_path / "l1.mp4"
    status, _, _ = run(capsys, "replay", str(record), "--out", str(out), "--size", "64")
    assert status == 0
    assert out.read_bytes()[4:8] == b"ftyp"


@pytest.mark.render
@pytest.mark.usefixtures("kept_views")
def test_a_trial_is_filmed_beside_its_twin(capsys, brief_run, tmp_path):
    """The command of the report: both start images with their paths first, then as many frames as the longer trial."""
    import av
    import numpy as np

    record = brief_run / "records" / "morning_coffee" / "L1" / "0.parquet"
    out = tmp_path / "twin.mp4"
    status, _, err = run(capsys, "replay", str(record), "--twin", "--size", "96", "--out", str(out))
    assert status == 0
    assert "alone" not in err
    with av.open(str(out)) as film:
        images = [frame.to_ndarray(format="rgb24").astype(int) for frame in film.decode(video=0)]
    wide = images[0].shape[1]
    assert wide > 2 * 96
    trial = read_record(record)
    twin = RunFolder.open(brief_run).read_record("morning_coffee", str(trial.metadata.base_condition), 0)
    lasting_s = (max(len(trial), len(twin)) - 1) / twin.metadata.control_rate_hz
    assert abs(len(images) / 10 - 2.0 - lasting_s) < 0.5
    for half in (images[0][:, : wide // 2], images[0][:, wide // 2 :]):
        red, green, blue = half[-96:].transpose(2, 0, 1)  # below the words, which may be blue too
        assert np.count_nonzero((blue > red + 70) & (blue > green + 30)) > 20, "no path of an open gripper"
    status, _, err = run(capsys, "replay", str(record), "--twin", "--size", "65", "--out", str(out))
    assert status == 2
    assert "--size" in err
    status, _, err = run(capsys, "replay", str(record), "--twin", "--check")
    assert status == 2
    assert "Leave out --twin or --check" in err.replace("\n", " ")


@pytest.mark.render
def test_show_writes_a_image(capsys, tmp_path):
    out = tmp_path / "images" / "t1.png"
    status, _, _ = run(capsys, "show", "fast_food/T1", "--out", str(out), "--size", "96")
    assert status == 0
    assert out.read_bytes().startswith(b"\x89PNG")


@pytest.mark.render
def test_report_is_one_page(capsys, brief_run, tmp_path, kept_processes):
    """All its pictures come from two processes, one for each side of a film."""
    asked = []

    def view(**options):
        asked.append(options)
        return kept_processes(**options)

    with used_by_commands(view):
        status, out, _ = run(capsys, "report", str(brief_run), "--out", str(tmp_path), "--films", "1")
    assert status == 0
    assert len(asked) == 2
    page = (tmp_path / "index.html").read_text()
    assert out.strip().endswith("index.html")
    assert "zoo:lexical" in page
    assert "data:image/jpeg" in page


def test_a_scene_that_cannot_be_drawn_costs_the_films_and_not_the_report(capsys, small_run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(small_run, copy)
    for scene in copy.rglob("*.zip"):
        scene.write_bytes(scene.read_bytes()[:100])
    status, _, err = run(capsys, "report", str(copy), "--out", str(tmp_path / "page"), "--films", "1")
    assert status == 0
    assert "no films: " in err
    assert "zoo:lexical" in (tmp_path / "page" / "index.html").read_text()


def test_the_terminal_ends_with_the_verdict(capsys, small_run, tmp_path):
    """In one line, after everything else; what a script reads from standard output is the path of the page."""
    line = "zoo:lexical: "
    _, out, _ = run(capsys, "diagnose", str(small_run), "--keep")
    assert any(text.startswith(line) for text in out.splitlines()[-3:]), "what would decide may follow"
    runs = str(small_run), str(shutil.copytree(small_run, tmp_path / "copy" / small_run.name))
    status, out, err = run(capsys, "report", *runs, "--out", str(tmp_path / "page"), "--films", "0")
    assert status == 0
    assert out.replace("\n", "").endswith("index.html")
    assert sum(text.startswith("zoo:lexical (run) #") for text in err.splitlines()[-6:]) == 2
    names = ("--name", "before", "--name", "after")
    _, _, err = run(capsys, "report", *runs, *names, "--out", str(tmp_path / "page"), "--films", "0")
    verdicts = [text for text in err.splitlines()[-6:] if text.startswith(("before: ", "after: "))]
    assert [text.partition(":")[0] for text in verdicts] == ["before", "after"]
    assert all("training " in text for text in verdicts)
    status, _, err = run(capsys, "compare", str(small_run), str(tmp_path), "--name", "only")
    assert status == 2
    status, _, err = run(
        capsys, "report", str(small_run), "--name", "a", "--name", "b", "--out", str(tmp_path / "page")
    )
    assert status == 2
    assert "--name: got 2 names for 1 run" in err.replace("\n", " ")


@pytest.mark.render
def test_doctor_finds_nothing_wrong_here(capsys):
    status, out, _ = run(capsys, "doctor", "--json")
    findings = json.loads(out)
    assert status == 0
    assert {f["name"] for f in findings} >= {"versions", "physics", "rendering", "video"}
    assert all(f["works"] for f in findings)


def test_doctor_prints_the_command_for_an_extra_on_one_line(capsys, monkeypatch):
    command = f"pip install {'long/' * 30}betterbench.whl[train]"
    found = [Check("versions", True, "fine"), Check("extra train", True, "not installed", command)]
    monkeypatch.setattr("betterbench.cli.checks.run_checks", lambda: found)
    status, out, _ = run(capsys, "doctor")
    assert (status, out.splitlines()[-2:]) == (0, ["To install an extra:", f"train: {command}"])
