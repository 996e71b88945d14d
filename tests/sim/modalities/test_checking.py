"""A check of a folder of modalities compares it with its run, and says what to do about what it finds."""

from __future__ import annotations

import dataclasses
import json
import shlex
import shutil
from pathlib import Path

import pytest
from tests.sim.modalities.conftest import draw_in_one_process

from betterbench.cli.main import EXIT_BAD_INPUT, main
from betterbench.errors import RecordError, RunConflictError
from betterbench.json_form import file_digest
from betterbench.records import JournalEntry, RunFolder
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.modalities.checking import check_folder
from betterbench.sim.modalities.folder import ModalityFolder, Wanted
from betterbench.sim.modalities.run import materialize_run
from betterbench.tasks import TrialId

pytestmark = [pytest.mark.physics, pytest.mark.render]

VIEW = ViewSpec("wrist", 48, 32)
NAME = f"{VIEW.name}.parquet"
OPTIONS = ["--camera", VIEW.text, "--modality", "boxes"]


def place(folder, seed):
    return folder / "fast_food" / "train1" / str(seed) / NAME


@pytest.fixture(scope="module")
def drawn(recorded, processes, tmp_path_factory):
    out = tmp_path_factory.mktemp("checked") / "modalities"
    with pytest.MonkeyPatch.context() as patch:
        draw_in_one_process(patch, processes)
        materialize_run(recorded.run, out, Wanted((VIEW,), ("boxes",)))
    return out


@pytest.fixture
def folder(drawn, tmp_path):
    return shutil.copytree(drawn, tmp_path / "views")


@pytest.fixture
def check(recorded, folder, capsys):
    """Checks the folder, and returns the exit status and the line that is told."""

    def checked(*words, run=recorded.run.path):
        status = main(["materialize", str(run), "--out", str(folder), "--check", *words])
        told = capsys.readouterr()
        return status, " ".join((told.out if status == 0 else told.err.split("error: ")[1]).split())

    return checked


def flipped(path, *, at):
    data = bytearray(path.read_bytes())
    data[int(at * len(data))] ^= 16
    path.write_bytes(data)


def test_what_is_intact_is_counted(recorded, check):
    rows = sum(len(record) for record in recorded.records.values())
    assert check() == (0, f"2 files with {rows} images are intact; no file is missing")
    assert check(*OPTIONS)[0] == 0


def test_a_missing_file_is_named_and_drawn_by_the_command_that_is_told(recorded, folder, check, one_process):
    place(folder, 1).unlink()
    status, told = check()
    assert status == EXIT_BAD_INPUT
    assert f"1 file missing or wrong: fast_food/train1/1/{NAME} is missing." in told
    assert check("--trial", "fast_food/train1/0")[0] == 0
    assert f"fast_food/train1/1/{NAME} is missing" in check("--trial", "fast_food/train1/1")[1]
    _, _, command = told.partition("To render them again: ")
    verb, *words = shlex.split(command)
    assert (Path(verb).name, main(words), check()[0]) == ("better", 0, 0)


def test_a_file_in_the_place_of_another_one_is_named_and_drawn_again(recorded, folder, check, one_process):
    right = place(folder, 0).read_bytes()
    shutil.copy(place(folder, 1), place(folder, 0))
    status, told = check()
    assert status == EXIT_BAD_INPUT
    assert f"fast_food/train1/0/{NAME} belongs to fast_food/train1/1." in told
    assert materialize_run(recorded.run, folder, Wanted((VIEW,), ("boxes",))).files == 1
    assert place(folder, 0).read_bytes() == right


def test_a_file_of_other_views_modalities_or_presets_is_named_and_drawn_again(
    recorded, folder, check, tmp_path, one_process
):
    right, wrong = place(folder, 0).read_bytes(), tmp_path / "wrong"
    for wanted, said in (
        (Wanted((ViewSpec("front", 48, 32),), ("boxes",)), "shows a different view (front:48x32)"),
        (Wanted((VIEW,), ("depth",)), "contains depth instead of boxes"),
        (Wanted((VIEW,), ("boxes",), "fast"), "was rendered with the preset fast instead of standard"),
    ):
        materialize_run(recorded.run, wrong, wanted, trials=[TrialId("fast_food", "train1", 0)])
        shutil.copy(place(wrong, 0).with_name(f"{wanted.views[0].name}.parquet"), place(folder, 0))
        shutil.rmtree(wrong)
        assert said in check()[1]
        assert materialize_run(recorded.run, folder, Wanted((VIEW,), ("boxes",))).files == 1
        assert place(folder, 0).read_bytes() == right


def test_a_file_that_was_damaged_behind_its_header_is_named_and_drawn_again(
    recorded, folder, check, caplog, one_process
):
    right = place(folder, 0).read_bytes()
    flipped(place(folder, 0), at=1 / 3)
    status, told = check()
    assert status == EXIT_BAD_INPUT
    assert f"fast_food/train1/0/{NAME} is damaged (" in told
    assert "Delete" not in told
    done = materialize_run(recorded.run, folder, Wanted((VIEW,), ("boxes",)))
    assert (done.files, done.kept) == (1, 1)
    assert place(folder, 0).read_bytes() == right
    assert f"{place(folder, 0)} is damaged (" in caplog.text
    assert "It is rendered again" in caplog.text


def test_files_that_the_run_does_not_ask_for_are_named(folder, check):
    shutil.copytree(folder / "fast_food" / "train1" / "1", folder / "fast_food" / "train1" / "7")
    place(folder, 1).with_name("notes.parquet").write_bytes(b"mine")
    status, told = check()
    assert status == EXIT_BAD_INPUT
    where = f"fast_food/train1/7/{NAME} belongs to fast_food/train1/1 by reaching"
    assert f"{where}, but the trial is not recorded or the view is unknown" in told
    assert f"Move {place(folder, 1).with_name('notes.parquet')}; {place(folder, 7)} away." in told
    assert "To render" not in told
    assert check("--trial", "fast_food/train1/0")[0] == 0


@pytest.mark.parametrize("seed", [0, 5])
def test_a_folder_of_another_run_is_no_folder_of_this_one(recorded, folder, check, tmp_path, seed):
    other = RunFolder.start(tmp_path / "other", {"policy": "another", "quality": {"name": "standard"}})
    record = recorded.records[0]
    meta = dataclasses.replace(record.metadata, policy="another", seed=seed)
    written = other.write_record(dataclasses.replace(record, metadata=meta))
    with other.journal() as journal:
        journal.append(
            JournalEntry("fast_food", "train1", None, seed, wall={"duration_s": 1.0}, record=file_digest(written))
        )
    status, told = check(run=other.path)
    assert status == EXIT_BAD_INPUT
    assert "the files do not belong to the records of" in told
    assert (
        "For example, one file belongs to fast_food/train1/0 by reaching. Pass the run from which the files were "
        "rendered" in told
    )
    assert "Delete" not in told


def test_a_check_with_other_options_than_the_folder_has_is_refused(check):
    for words in (["--camera", "wrist:49x32"], ["--camera", VIEW.text, "--modality", "depth"]):
        status, told = check(*words)
        assert status == EXIT_BAD_INPUT
        assert "contains a different set of modalities" in told
    assert "fast_food/train1/77 is not recorded" in check("--trial", "fast_food/train1/77")[1]


def test_many_problems_are_one_line_and_all_in_json(recorded, folder, capsys):
    for seed in range(20, 30):
        shutil.copytree(folder / "fast_food" / "train1" / "1", folder / "fast_food" / "train1" / str(seed))
    assert main(["materialize", str(recorded.run.path), "--out", str(folder), "--check", "--json"]) == EXIT_BAD_INPUT
    told = capsys.readouterr()
    assert len(json.loads(told.out)["problems"]) == 10
    assert "and 7 more (--json lists all)" in " ".join(told.err.split())


def test_no_damage_to_a_file_goes_beyond_one_line(recorded, folder):
    path, good = place(folder, 0), place(folder, 0).read_bytes()
    for number, bad in enumerate((b"", b"PAR1", good[: len(good) // 2], good[:-4] + b"XXXX", b"\0" * 100)):
        path.write_bytes(bad)
        (problem,) = check_folder(recorded.run, folder).problems
        assert (number, problem.path, problem.kind) == (number, path, "damaged")
        assert "\n" not in problem.text
    path.unlink()
    path.mkdir()
    (problem,) = check_folder(recorded.run, folder).problems
    assert problem.kind == "damaged"


def test_an_unknown_trial_leaves_no_folder_behind(recorded, tmp_path):
    out = tmp_path / "views"
    with pytest.raises(RecordError, match="fast_food/train1/9 is not recorded"):
        materialize_run(recorded.run, out, Wanted((VIEW,)), trials=[TrialId("fast_food", "train1", 9)])
    assert not out.exists()


def test_settings_bind_a_folder_as_soon_as_it_holds_a_file(folder, tmp_path):
    out = tmp_path / "new"
    ModalityFolder(out, Wanted((VIEW,), ("boxes",))).claim({"renderer": "a card"})
    other = ModalityFolder(out, Wanted((VIEW,), ("rgb",)))
    assert other.wanted == Wanted((VIEW,), ("rgb",))
    assert ModalityFolder(out, Wanted((VIEW,), ("rgb",))).wanted.modalities == ("rgb",)
    part = out / "fast_food" / "train1" / "0" / f".{NAME}.x.part"  # somebody is drawing
    part.parent.mkdir(parents=True)
    part.write_bytes(b"half")
    for begun in (out, folder):
        with pytest.raises(RunConflictError, match="contains a different set of modalities"):
            ModalityFolder(begun, Wanted((VIEW,), ("depth",)))
