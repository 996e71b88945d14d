"""The script that poses scenes for blind judges: lines between an accepted and a denied arrangement, and the votes."""

from __future__ import annotations

import dataclasses
import importlib
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.tasks.arranging import arranged, clauses_of, condition_of

TOOLS = Path(__file__).resolve().parents[2] / "tools"
HEAD = "number\tkind\tsetting\tthing\ttarget\tregion\tposture\tinstruction\tquestion\tarrangement\tprogram\tt\tborder\n"


@pytest.fixture
def scenes(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("judged_scenes")


def test_a_clause_goes_from_the_good_to_the_bad_end(scenes):
    pose = scenes.Pose("fork", "plate.left", {"x": 10.0, "z": 2.0}, {"x": 110.0, "turn": 40.0}, ("flip",))
    clause = clauses_of(pose.at(0.25))[0]
    assert clause.numbers == {"x": 35.0, "z": 2.0, "turn": 10.0}
    assert clause.flags == {"flip", "settle"}


@dataclasses.dataclass
class Line:
    """A line whose verdict changes at one point."""

    border: float

    def accepted(self, t: float) -> bool:
        return t < self.border


@pytest.mark.parametrize("border", [0.02, 0.3, 0.97])
def test_the_border_of_a_line_is_found(scenes, border):
    assert scenes.border_of(Line(border)) == pytest.approx(border, abs=0.5 ** (scenes.BISECTIONS + 1))


@pytest.mark.parametrize("border", [-1.0, 2.0])
def test_a_line_with_one_verdict_has_no_border(scenes, border):
    assert scenes.border_of(Line(border)) is None


@pytest.mark.parametrize("task", ["breakfast_table", "office_drawer", "cheeseburger"])
def test_a_drawn_scene_is_possible_and_its_line_crosses_a_border(scenes, task):
    poser = scenes.Poser(5)
    question, t, border = scenes.drawn(poser, lambda: poser.goal(task), near=True)
    assert (question.accepted(0.0), question.accepted(1.0)) == (True, False)
    assert abs(t - border) <= scenes.NEAR
    assert scenes.fault_of(question.setting, question.at(t)) == ""
    assert question.question.startswith("Is this step done: the ")


class InThisProcess:
    """Stands for the executor of processes; the jobs end in the order in which they were submitted."""

    def __init__(self, *_, **__):
        self.jobs, self.found = [], {}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def submit(self, function, *arguments):
        self.jobs.append((function, arguments))
        return SimpleNamespace(result=partial(self._result, len(self.jobs) - 1))

    def order(self):
        return range(len(self.jobs))

    def _result(self, number):
        if not self.found:
            for k in self.order():
                function, arguments = self.jobs[k]
                self.found[k] = function(*arguments)
        return self.found[number]


class Backwards(InThisProcess):
    """Ends the last job first, as another process may."""

    def order(self):
        return reversed(super().order())


@pytest.mark.render
@pytest.mark.parametrize(
    ("executor", "side_px"), [(Backwards, 180), pytest.param(ProcessPoolExecutor, 720, marks=pytest.mark.slow)]
)
def test_the_folder_for_judges_holds_no_verdict_and_several_processes_give_the_same(
    scenes, tmp_path, monkeypatch, executor, side_px
):
    monkeypatch.setattr(scenes, "SIDE_PX", side_px)
    sets = []
    for workers, used in (("1", InThisProcess), ("2", executor)):
        monkeypatch.setattr(scenes, "ProcessPoolExecutor", used)
        out = tmp_path / workers
        scenes.main(["draw", str(out), "--count", "2", "--seed", "4", "--near-border", "0", "--workers", workers])
        shown = {path.name: path.read_bytes() for path in (out / "for_judges").iterdir()}
        assert sorted(shown) == ["001.png", "002.png", "HOW.md", "scenes.tsv"]
        assert {path.stat().st_mtime for path in (out / "for_judges").iterdir()} == {0.0}
        table = shown["scenes.tsv"].decode().splitlines()
        assert table[0] == "number\tkind\tinstruction\tquestion"
        hidden = (out / "hidden" / "verdicts.tsv").read_text()
        assert "program" in hidden.splitlines()[0]
        sets.append((shown, hidden))
    assert sets[0] == sets[1]


def test_the_seed_decides_what_is_asked(scenes):
    first, again, other = (scenes.Poser(seed).cutlery("slanted").at(0.0) for seed in (1, 1, 2))
    assert first == again != other


def test_the_question_of_harm_is_about_what_the_instruction_does_not_name(scenes):
    poser = scenes.Poser(2)
    for _ in range(4):
        question = poser.harm("breakfast_table")
        assert question.accepted(0.0)
        assert question.clauses[0].thing in ("plate", "bowl", "salt", "jam", "egg", "tumbler", "cup", "fork", "spoon")
        assert question.clauses[0].thing not in {c.thing for c in question.clauses[1:]}


def test_a_scene_in_which_something_is_pushed_away_is_not_possible(scenes):
    setting = "breakfast_table/train1"
    assert scenes.fault_of(setting, "fork plate.left z=2 settle") == ""
    start, _ = arranged(setting, "fork plate.left z=2 settle")
    assert scenes.fault_of(setting, "fork slot:front z=0 settle") != "", "the cup stands there"
    assert start.info.object("cup").slot == "front"


def question_about(scenes, setting, arrangement, *, pair=None):
    """Returns a question about an arrangement: of a goal, or of harm to the first object if there is no pair."""
    kind, thing, target = ("harm", "-", "-") if pair is None else ("beside", *pair)
    clauses = tuple(scenes.Pose(part.split()[0], "from") for part in arrangement.split(";"))
    return scenes.Question(kind, setting, thing, target, "left", clauses, "Put it.", "?")


@pytest.mark.parametrize(
    ("setting", "arrangement", "pair", "expected"),
    [
        ("desk_meeting/O1", "mug laptop.left z=2 settle", ("mug", "laptop"), ""),
        # the scene of the fifth set in which the mug is not in the image
        (
            "desk_meeting/O1",
            "mug laptop.left x=94.7 y=-191.3 z=2 settle",
            ("mug", "laptop"),
            "mug is outside of a view",
        ),
        (
            "breakfast_table/train1",
            "fork plate.left y=-90 z=2 settle; cup plate.upper_right z=2 settle",
            ("cup", "plate"),
            "not done: beside(fork, plate)",
        ),
        (
            "breakfast_table/train1",
            "jam from x=60 z=1 settle; fork plate.left z=2 settle; cup plate.upper_right z=2 settle",
            None,
            "",
        ),
        (
            "breakfast_table/train1",
            "jam from x=60 z=1 settle; fork plate.left z=2 turn=180 settle; cup plate.upper_right z=2 settle",
            None,
            "not done: fork_left",
        ),
        ("desk_meeting/L2", "speaker from x=900 z=1 settle", None, "speaker is outside of a view"),
    ],
)
def test_judges_see_what_is_in_question_and_what_the_text_calls_done_is_done(
    scenes, setting, arrangement, pair, expected
):
    assert scenes.unfair_of(question_about(scenes, setting, arrangement, pair=pair), arrangement) == expected


@pytest.mark.parametrize("name", ["train3", "L2"])
def test_a_mug_named_by_its_place_is_named_by_its_color_too(scenes, name):
    """The picture shows the end, where the top mug is no longer at the top."""
    condition = condition_of(f"morning_coffee/{name}")
    ((goal, thing, below),) = scenes.steps_of(condition)
    kind, word = condition.object(thing).kind, goal.word
    question = scenes.step_words(condition, goal, thing, below)
    assert f": the {kind}, which was the {word} one at the start, is inside the ring" in question


def planned(scenes, count, **shares):
    """Returns the kind of each scene of a set, whether it is near the border, and its end of the line."""
    both = {"near_border": scenes.HALF, "cutlery": scenes.FIFTH} | {n: scenes.share(v) for n, v in shares.items()}
    return [(wanted.kind, wanted.near, wanted.end) for wanted in scenes.planned(count, **both)]


def test_by_default_half_of_the_scenes_are_near_the_border(scenes):
    asked = planned(scenes, 10)
    assert [near for _, near, _ in asked] == [True, False] * 5
    assert [kind for kind, _, _ in asked] == ["goal", "harm", "goal", "cutlery", "goal"] * 2
    assert {end for _, _, end in asked} == {None}


def test_a_set_as_a_person_would_check_is_ordinary(scenes):
    asked = planned(scenes, 40, near_border="0.15", cutlery="0.1")
    assert sum(near for _, near, _ in asked) == 6
    kinds = [kind for kind, _, _ in asked]
    assert (kinds.count("cutlery"), kinds.count("harm"), kinds.count("goal")) == (4, 8, 28)
    for kind in ("goal", "harm"):
        ends = [end for k, near, end in asked if k == kind and not near]
        assert min(ends.count(0.0), ends.count(1.0)) >= 0.3 * len(ends)
    assert {end for _, near, end in asked if near} == {None}


def test_the_tasks_of_the_suite_take_turns(scenes):
    subjects = [w.subject for w in scenes.planned(50, near_border=scenes.HALF, cutlery=scenes.FIFTH)]
    assert len({subjects[i] for i in range(50) if i % 5 == 1}) == 10
    assert set(subjects[3::5]) == set(scenes.POSTURES)


@pytest.mark.parametrize(("end", "low", "high"), [(0.0, 0.0, 0.2), (1.0, 0.8, 1.0)])
def test_an_ordinary_scene_is_at_an_end_of_its_line(scenes, end, low, high):
    poser = scenes.Poser(5)
    question, t, _ = scenes.drawn(poser, lambda: poser.goal("cheeseburger"), near=False, end=end)
    assert low <= t <= high
    assert question.accepted(t) is (end == 0.0)


@pytest.mark.parametrize("text", ["2", "-0.1", "some", "1/0"])
def test_a_share_is_a_number_from_0_to_1(scenes, capsys, tmp_path, text):
    with pytest.raises(SystemExit):
        scenes.main(["draw", str(tmp_path), "--seed", "1", f"--near-border={text}"])
    assert f"{text!r} is not a number from 0 to 1" in capsys.readouterr().err


def test_the_question_states_the_direction_of_cutlery(scenes):
    question = scenes.Poser(3).cutlery("slanted")
    assert question.question.endswith(
        ", with the handle of the " + question.thing + " pointing to the front, not to a side?"
    )


@pytest.fixture
def posed(tmp_path):
    """A folder with three scenes and the verdicts of the program: y, n, y."""
    (tmp_path / "hidden").mkdir()
    rows = [
        f"{number}\tbeside\tbreakfast_table/L1\tfork\tplate\tleft\t\tPut it.\t?\tfork plate.left settle\t{verdict}\t0\t"
        for number, verdict in (("001", "y"), ("002", "n"), ("003", "y"))
    ]
    (tmp_path / "hidden" / "verdicts.tsv").write_text(HEAD + "\n".join(rows) + "\n")
    return tmp_path


def answers(folder: Path, name: str, *votes: str) -> Path:
    path = folder / name
    path.write_text("".join(f"{i:03d}\t{v}\twords\n" for i, v in enumerate(votes, start=1)))
    return path


def test_the_majority_of_the_judges_is_compared_with_the_program(scenes, posed):
    files = [
        answers(posed, "1.tsv", "y\tsure", "n\tsure", "n\tsure"),
        answers(posed, "2.tsv", "y\tsure", "y\tunsure", "n\tsure"),
        answers(posed, "3.tsv", "n\tsure", "n\tsure", "n\tsure"),
    ]
    lines = list(scenes.judge(posed, files))
    assert (
        lines[0] == "beside, sure | breakfast_table/L1 | fork > plate | left | fork plate.left settle | yyn | Put it."
    )
    assert lines[1].startswith("beside, unsure |")
    assert lines[2].startswith("# program y, 003: beside, sure |")
    assert [line.partition(" agree")[0] for line in lines[3:]] == [
        *("# all: 2/3", "# goals: 2/3", "# sure: 1/2", "# unsure: 1/1")
    ]


def test_an_answer_in_other_words_is_refused(scenes, posed):
    file = answers(posed, "1.tsv", "yes\tsure", "n\tsure", "n\tsure")
    with pytest.raises(ValueError, match=r"1\.tsv: scene 001 has \['yes', 'sure'\]; expected y or n"):
        list(scenes.judge(posed, [file]))


def test_an_answer_that_is_missing_is_named(scenes, posed):
    file = answers(posed, "1.tsv", "y\tsure")
    with pytest.raises(ValueError, match=r"1\.tsv: no answer for scene 002"):
        list(scenes.judge(posed, [file]))


WRITTEN = """# written by hand

beside | breakfast_table/train1 | fork > plate | left | fork plate.left z=2 turn=5 settle
beside | breakfast_table/train1 | fork > plate | left | fork plate.left x=-200 z=2 flip settle
harm | breakfast_table/train1 | - | - | fork plate.left z=2; cup plate.upper_right z=2; jam from x=100 z=1 settle
"""


@pytest.fixture
def written(tmp_path):
    (tmp_path / "scenes.txt").write_text(WRITTEN)
    return tmp_path / "scenes.txt"


def test_a_written_scene_is_read(scenes, written):
    near, far, harm = scenes.read_scenes(written)
    assert (near.thing, near.target, near.region) == ("fork", "plate", "left")
    assert near.question.startswith("Is this step done: the fork is next to the plate on the left")
    assert far.at(0.0) == "fork plate.left x=-200.0 z=2.0 flip settle"
    assert (harm.kind, harm.thing, harm.question) == ("harm", "-", scenes.HARM_QUESTION)
    assert len(harm.clauses) == 3


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("beside | breakfast_table/train1 | fork > plate", r"3 parts"),
        (
            "beside | breakfast_table/train1 | spoon > plate | right | spoon plate.right settle",
            r"scenes\.txt:1: .*has no step beside \| spoon > plate \| right; it has beside \| fork > plate \| left",
        ),
        (
            "beside | breakfast_table/train1 | fork > plate | left | knife plate.left settle",
            r"has no object 'knife'; it has bowl, cup",
        ),
    ],
)
def test_a_wrong_line_is_named(scenes, tmp_path, line, message):
    (tmp_path / "scenes.txt").write_text(line + "\n")
    with pytest.raises(ValueError, match=message):
        list(scenes.read_scenes(tmp_path / "scenes.txt"))


@pytest.mark.render
def test_written_scenes_are_shown_without_verdicts_which_are_computed_when_they_are_judged(
    scenes, written, tmp_path, capsys, monkeypatch
):
    out = tmp_path / "set"
    monkeypatch.setattr(scenes, "SIDE_PX", 180)
    with monkeypatch.context() as blind:
        blind.setattr(scenes, "accepts", lambda *_: pytest.fail("the verdict of the program was computed"))
        scenes.main(["pose", str(written), str(out), "--seed", "1"])
    assert capsys.readouterr().err == ""
    assert sorted(p.name for p in (out / "for_judges").iterdir()) == [
        *("001.png", "002.png", "003.png", "HOW.md", "scenes.tsv")
    ]
    hidden = scenes.read_table(out / "hidden" / "verdicts.tsv")
    assert {row["program"] for row in hidden} == {""}
    votes = ["y\tsure" if "turn=5.0" in row["arrangement"] else "n\tsure" for row in hidden]
    lines = list(scenes.judge(out, [answers(tmp_path, "1.tsv", *votes)]))
    assert "# all: 3/3" in [line.partition(" agree")[0] for line in lines]
