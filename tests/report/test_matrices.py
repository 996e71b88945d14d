"""The diagnostic matrices: conditions find their cells by what they are, and every trial is counted once."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.looping import each

sys.path.insert(0, str(Path(__file__).parent))

from factory import diagnosis, draw_frame, trial

from betterbench.diagnosis import Evidence, Label
from betterbench.report import Film, Frame, write_report
from betterbench.report.figures.media import NO_MEDIA, Media, Thumbnails
from betterbench.report.pages.cell_pictures import ShownFilm, cell_pictures
from betterbench.report.tables.cell_position import CellPosition, known_conditions, position_of
from betterbench.report.tables.latex import table_to_latex
from betterbench.report.tables.matrices import PAPER, matrices_of, plain_matrix
from betterbench.report.tables.table import to_csv
from betterbench.tasks import all_tasks
from betterbench.tasks.authoring.condition_matrix import Horizon, State
from betterbench.tasks.condition import TargetRegion as At
from betterbench.tasks.interventions.resolve import resolve_condition

TABLE, TARGET, ABSENT = State


def place(task, name):
    setting = resolve_condition(task, name)
    return position_of(setting.condition, training=setting.axis is None)


@each(
    "task, name, expected",
    [
        ("morning_coffee", "train1", (Horizon.SHORT, TABLE, TABLE)),
        ("morning_coffee", "T1", (Horizon.SHORT, TARGET, TABLE)),
        ("seasoning_rack", "L2", (Horizon.SHORT, TABLE, TARGET)),
        ("dinner_plates", "train3", (Horizon.SHORT, TABLE, ABSENT)),
        ("fruit_lunch", "train1", (Horizon.LONG, TABLE, TABLE)),
        ("fruit_lunch", "T1", (Horizon.LONG, TARGET, TABLE)),
        ("fruit_lunch", "O1", (Horizon.LONG, ABSENT, TABLE)),
        ("dinner_plates", "T2", (Horizon.LONG, TARGET, TABLE)),
        ("office_drawer", "train1", (Horizon.SHORT, TABLE, TABLE)),
    ],
)
def test_conditions_of_the_suite_find_their_cells(task, name, expected):
    assert place(task, name) == CellPosition(*expected)


@pytest.mark.parametrize(
    ("task", "name"), [("fruit_lunch", "L1"), ("fruit_lunch", "R1"), ("desk_meeting", "T1"), ("cheeseburger", "train1")]
)
def test_other_interventions_and_other_lengths_belong_to_neither(task, name):
    assert place(task, name) is None


def lunch(apple, orange):
    """Returns the training condition of the fruit lunch with apple and orange in any state."""
    base = resolve_condition("fruit_lunch", "train1").condition
    objects, layout, preplaced = base.objects, dict(base.layout), {}
    for name, state in (("apple", apple), ("orange", orange)):
        if state is not TABLE:
            del layout[name]
        if state is TARGET:
            preplaced[name] = At("lunchbox")
        if state is ABSENT:
            objects = tuple(o for o in objects if o.name != name)
    return base.with_(objects=objects, layout=layout, preplaced=preplaced)


@each("second", tuple(State))
@each("first", tuple(State))
def test_every_cell_of_the_long_matrix_can_be_reached(first, second):
    condition = lunch(first, second)
    assert position_of(condition, training=True) == CellPosition(Horizon.LONG, first, second)
    renamed = condition.with_(
        objects=tuple(replace(o, name=f"x_{o.name}") if o.role == "item" else o for o in condition.objects),
        layout={n if n == "lunchbox" else f"x_{n}": s for n, s in condition.layout.items()},
        preplaced={f"x_{n}": p for n, p in condition.preplaced.items()},
    )
    assert position_of(renamed, training=True) == CellPosition(Horizon.LONG, first, second)


@each("second", tuple(State))
@each("first", tuple(State))
def test_every_cell_of_the_short_matrix_can_be_reached(first, second):
    condition = lunch(first, second)
    kept = tuple(o for o in condition.objects if o.name != "lemon")
    layout = {n: s for n, s in condition.layout.items() if n != "lemon"}
    instruction = replace(condition.instruction, subgoals=condition.instruction.subgoals[:1])
    short = condition.with_(objects=kept, layout=layout, instruction=instruction)
    assert position_of(short, training=True) == CellPosition(Horizon.SHORT, first, second)


def test_the_second_of_two_equal_objects_has_a_state_of_its_own():
    condition = resolve_condition("fruit_lunch", "T2").condition
    one = condition.with_(objects=tuple(o for o in condition.objects if o.name != "apple_2"))
    assert position_of(one, training=True) == CellPosition(Horizon.LONG, TABLE, ABSENT)
    packed = condition.with_(preplaced={"apple": At("lunchbox")})
    assert position_of(packed, training=True) == CellPosition(Horizon.LONG, TARGET, TABLE)


def trials(task, name, labels, *, training=False):
    variation = None if training else name
    return [
        trial(task, variation, name if training else "train1", seed, label=label) for seed, label in enumerate(labels)
    ]


@pytest.fixture
def run():
    conflict = [Label.PHASE_CONFLICT] * 3 + [Label.SUCCESS] + [Label.EARLY_HALT] * 2
    return diagnosis(
        [
            *trials("fruit_lunch", "train1", [Label.SUCCESS] * 4, training=True),
            *trials("fruit_lunch", "train2", [Label.SUCCESS, Label.TIMEOUT], training=True),
            *trials("fruit_lunch", "T1", conflict),
            *trials("fruit_lunch", "L1", [Label.LEXICAL_KINEMATIC_SHORTCUT] * 5),
            *trials("morning_coffee", "T1", [Label.CORRECT_FREEZE] * 3),
        ],
        policy="zoo:halt",
    )


def test_cells_count_outcomes(run):
    short, long = matrices_of(run)
    conflict = long.cell(TARGET, TABLE)
    assert (conflict.success.k, conflict.success.n) == (1, 6)
    assert conflict.labels == ((Label.PHASE_CONFLICT, 3), (Label.EARLY_HALT, 2), (Label.SUCCESS, 1))
    assert [s.id for s in conflict.sources] == ["fruit_lunch/T1"]
    assert conflict.paper == "phase conflict I: freezes or skips"
    standard = long.cell(TABLE, TABLE)
    assert (standard.success.k, standard.success.n) == (5, 6)
    assert [(s.id, s.success.k, s.success.n) for s in standard.sources] == [
        ("fruit_lunch/train1", 4, 4),
        ("fruit_lunch/train2", 1, 2),
    ]
    assert short.cell(TARGET, TABLE).labels == ((Label.CORRECT_FREEZE, 3),)
    assert short.policy == long.policy == "zoo:halt"
    assert short.measured
    assert long.measured


def test_empty_cells_say_why(run):
    short, long = matrices_of(run)
    assert long.cell(ABSENT, TABLE).note == "Not in this run: fruit_basket/O7, fruit_lunch/O1."
    assert long.cell(ABSENT, ABSENT).note == "Not in this run: fruit_basket/O9."
    assert matrices_of(diagnosis([trial()]))[1].cell(TABLE, TABLE).note.endswith("breakfast_table/train4 and 26 more.")
    for cell in (c for m in (short, long) for row in m.cells for c in row):
        assert cell.empty == bool(cell.note)
        assert cell.paper


def test_a_run_without_such_conditions_fills_nothing():
    matrices = matrices_of(diagnosis(trials("fruit_lunch", "R1", [Label.SUCCESS])))
    assert not any(m.measured for m in matrices)


def test_every_trial_that_belongs_is_counted_once():
    everything = [
        trial(t.id, None if thing in t.training else thing.name, thing.name if thing in t.training else thing.base)
        for t in all_tasks()
        for thing in (*t.training, *t.variations)
    ]
    matrices = matrices_of(diagnosis(everything))
    counted = sum(c.success.n for m in matrices for row in m.cells for c in row)
    assert counted == sum(len(ids) for ids in known_conditions().values())


def test_the_plain_form_has_nine_rows_per_policy(run):
    long = matrices_of(run)[1]
    table = plain_matrix([long, replace(long, policy="=evil")])
    assert len(table.rows) == 18
    assert table.columns[:3] == ("policy", "first_target", "second_target")
    assert all(len(row) == len(table.columns) for row in table.rows)
    row = next(r for r in table.rows if r[1:3] == ("at the target", "on the table"))
    assert row[3:6] == (1, 6, 1 / 6)
    assert row[6] < row[5] < row[7]
    assert row[8:10] == (0, "phase_conflict 3, early_halt 2, success 1")
    empty = next(r for r in table.rows if r[1:3] == ("absent", "absent"))
    assert empty[3:8] == (0, 0, None, None, None)
    assert "'=evil" in to_csv(table)
    assert "phase\\_conflict 3" in table_to_latex(table)


def test_a_success_with_a_needless_step_is_counted_in_its_cell_and_shown_on_the_page(tmp_path):
    step = Evidence("air_grasp_at_memorized_slot", "The gripper closes without an object at slot 'first'.", 3.2, 3.9)
    done = [trial("fruit_lunch", "T1", seed=s, needless=(step,) if s < 2 else ()) for s in range(5)]
    run = diagnosis(done)
    cell = matrices_of(run)[1].cell(TARGET, TABLE)
    assert (cell.success.k, cell.success.n, cell.needless) == (5, 5, 2)
    page = write_report([run], tmp_path).read_text()
    assert "5/5</b> right, 2 of them with a needless step" in page
    assert "Success with a needless step" in page
    assert step.text in page, "the list of trials shows the evidence"
    assert "Needless step at" in page


def test_a_cell_shows_the_training_twins_of_its_trials(tmp_path):
    twins = [Label.SUCCESS, Label.TIMEOUT, Label.SUCCESS]
    done = [
        *(trial("fruit_basket", None, "train3", seed, label=label) for seed, label in enumerate(twins)),
        *(trial("fruit_basket", "O6", "train3", seed, label=Label.BEHAVIORAL_INERTIA) for seed in (0, 1, 7)),
        trial("fruit_basket", "T5", "train3", 9),
    ]
    run = diagnosis(done)
    long = matrices_of(run)[1]
    assert (long.cell(TABLE, ABSENT).twins.k, long.cell(TABLE, ABSENT).twins.n) == (1, 2)
    assert long.cell(TABLE, TABLE).twins.n == long.cell(TARGET, TABLE).twins.n == 0
    row = next(r for r in plain_matrix([long]).rows if r[1:3] == ("on the table", "absent"))
    assert row[-2:] == (1, 2)
    assert "training twins: 1/2 right" in write_report([run], tmp_path).read_text()


def test_a_cell_shows_its_film_and_otherwise_its_scene():
    image = draw_frame(np.random.default_rng(0))
    done = [trial("fruit_basket", None, "train3", 0), trial("fruit_basket", "T5", "train3", 0)]
    done += [trial("fruit_basket", "O6", "train3", s, label=Label.BEHAVIORAL_INERTIA) for s in range(2)]
    done += [trial("fruit_basket", "O6", "train3", 2)]
    run = diagnosis(done)
    frames = (Frame(0.0, image, "start"), Frame(3.0, image, "attempt"))
    films = [Film("expert", f"fruit_basket/O6/{seed}", frames) for seed in (2, 1)]
    shown = [ShownFilm(i, f, next(t for t in done if t.key == f.trial)) for i, f in enumerate(films)]
    media = Media(thumbnails={"fruit_basket/T5": Thumbnails(image, image), "fruit_basket/T1": Thumbnails(image)})
    pictures = cell_pictures(matrices_of(run), shown, media)
    name = "long_horizon_matrix", "expert"
    inertia = pictures[(*name, "on the table", "absent")]
    assert (inertia.film, inertia.frame.caption, inertia.text) == (1, "attempt", "fruit_basket/O6/1, 3.0 s")
    assert pictures[(*name, "at the target", "on the table")].text == "scene of fruit_basket/T5"
    assert pictures[(*name, "on the table", "on the table")].text == "scene of fruit_basket/train3"
    assert pictures.keys() == {(*name, *key) for key in PICTURED}
    assert cell_pictures(matrices_of(run), [], NO_MEDIA) == {}


PICTURED = {("on the table", "absent"), ("at the target", "on the table"), ("on the table", "on the table")}


def test_no_run_gives_an_empty_table():
    assert plain_matrix([]).rows == ()


def test_the_paper_s_cells_are_three_by_three():
    for rows in PAPER.values():
        assert [len(row) for row in rows] == [3, 3, 3]
