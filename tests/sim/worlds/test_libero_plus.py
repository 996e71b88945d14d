"""LIBERO-Plus: what names say, which variants are planned, how they are paired, and its noise to the bit."""

import hashlib
import importlib
import itertools
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.looping import each

from betterbench.comparison.across import gaps_of, read_suite_runs
from betterbench.diagnosis import diagnose_run
from betterbench.errors import InvalidInputError, MissingDependencyError, UnknownNameError
from betterbench.evaluation import evaluate
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.report.outcomes import variation_rows
from betterbench.report.pages.page import write_report
from betterbench.report.pages.trust import trust_of
from betterbench.sim.worlds import world_named
from betterbench.sim.worlds.installation import Installation, start_code
from betterbench.sim.worlds.libero_plus import plus_command
from betterbench.sim.worlds.libero_plus.noise import Noise
from betterbench.sim.worlds.libero_plus.simulator import initial_states_in, seen_from
from betterbench.sim.worlds.libero_plus.world import ASSETS_VARIABLE
from betterbench.statistics import PairedTable, exchange_p, mcnemar_p
from betterbench.tasks.worlds.libero import PLUS_SUITES, SUITES, suite_named
from betterbench.tasks.worlds.libero_plus import AXES, TITLES, CameraView, axis_of, read_variant

STRAIGHT = "_view_0_0_100_0_0_initstate_0"


@pytest.fixture
def command():
    folder = str(Path(__file__).parent)
    return (sys.executable, "-c", f"import sys; sys.path.append({folder!r})\n{start_code('fake_plus')}")


@pytest.fixture
def plan_of(command):
    def plan(policy="noop", suite="libero_plus_object", steps=190, **options):
        made = make_world_plan(policy, suite=suite, command=command, **{"tasks": ["0", "1"], **options})
        protocol = replace(made.world.protocol, steps={"libero_object": steps})
        return replace(made, world=replace(made.world, protocol=protocol))

    return plan


@each(
    "ending, axis, condition, file",
    [
        ("_view_0_0_100_2_352_initstate_0", "camera", "camera_0_0_100_2_352", ""),
        ("_view_43_15_180_0_0_initstate_0", "camera", "camera_43_15_180_0_0", ""),
        ("_view_0_0_100_0_0_initstate_323", "robot", "robot_323", ""),
        (f"{STRAIGHT}_noise_38", "noise", "noise_38", ""),
        (f"_language_12{STRAIGHT}", "language", "language_12", "_language_12"),
        ("_light_7", "light", "light_7", "_light_7"),
        ("_table_17", "background", "background_table_17", "_table_17"),
        ("_tb_4", "background", "background_tb_4", "_tb_4"),
        ("_add_20", "layout", "layout_add_20", "_add_20"),
        ("_level3_sample2", "layout", "layout_level3_sample2", "_level3_sample2"),
        ("_moved_level1_sample4", "layout", "layout_level1_sample4", "_moved_level1_sample4"),
    ],
)
@each("base", ["pick_up_the_bowl_from_table_center", "KITCHEN_SCENE3_turn_on_the_stove"])
def test_a_name_says_what_is_changed(base, ending, axis, condition, file):
    variant = read_variant(base + ending)
    assert (variant.base, variant.axis, variant.condition) == (base, axis, condition)
    assert variant.file == base + file
    assert variant.own == (axis == "layout")
    assert variant.states == (variant.file if variant.own else base)
    assert axis_of(condition) == axis


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("pick_up_the_bowl", "changes nothing"),
        (f"pick_up_the_bowl{STRAIGHT}", "changes nothing"),
        ("bowl_view_2_0_100_0_0_initstate_4", "changes camera and robot"),
        (f"bowl_language_2{STRAIGHT}_noise_4", "changes language and noise"),
        (f"bowl{STRAIGHT}_noise_51", "noise index 51, but the largest noise index is 50"),
    ],
)
def test_a_name_of_another_form_is_refused(name, problem):
    with pytest.raises(ValueError, match=problem):
        read_variant(name)


@pytest.mark.parametrize("condition", [None, "base", "swap", "camera", "noises_3", "train1", "task_2"])
def test_conditions_of_other_worlds_are_on_no_axis_of_it(condition):
    assert axis_of(condition) is None


def test_the_suites_share_their_tasks_with_libero():
    assert sorted(PLUS_SUITES) == ["libero_plus_10", "libero_plus_goal", "libero_plus_object", "libero_plus_spatial"]
    for name, suite in PLUS_SUITES.items():
        assert suite_named(name).base in SUITES
        assert suite.tasks == 10
    assert AXES.keys() == TITLES.keys()


def test_a_plan_runs_each_variant_once_and_says_what_wants_the_assets(plan_of):
    plan = plan_of()
    assert [t.condition for t in plan.trials if t.task == "libero_object-01"] == [
        "layout_level1_sample1",
        *(f"camera_{around}_0_100_0_0" for around in (2, 10, 20, 40)),
        "robot_5",
        "language_3",
        "noise_12",
    ]
    assert {(t.seed, t.base_condition) for t in plan.trials} == {(0, "base")}
    assert all(t.axis == axis_of(t.variation) == axis_of(t.condition) for t in plan.trials)
    form = plan.to_json()["world"]
    assert form["left_out"] == {"layout": 2, "light": 2, "background": 2}
    told = form["tasks"]["libero_object-01/noise_12"]
    assert told["instruction"] == "pick up the ball and place it in the basket"
    assert form["tasks"]["libero_object-01/language_3"]["instruction"] == "shift the thing"


def test_axes_variants_states_and_published_sentences_are_choices(plan_of):
    plan = plan_of(axes=["camera", "layout"], variants=2, trials=3, seed=4, libero_plus_sentences="published")
    assert [(t.condition, t.seed) for t in plan.trials if t.task == "libero_object-00"] == [
        ("layout_level1_sample1", 0),
        *((f"camera_{around}_0_100_0_0", state) for around in (2, 20) for state in (4, 5, 6)),
    ]
    told = plan.to_json()["world"]["tasks"]["libero_object-00/camera_2_0_100_0_0"]
    assert told["instruction"] == "task 0 view 2 0 100 0 0 initstate 0"


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"axes": ["light", "background"]}, InvalidInputError, "none of the 4 variants.*scenes/some.xml.*Download"),
        ({"axes": ["lights"]}, UnknownNameError, "light"),
        ({"variants": 0}, InvalidInputError, "--variants"),
        ({"trials": 51}, InvalidInputError, "--trials"),
        ({"libero_plus_sentences": "dirty"}, UnknownNameError, "published"),
        ({"tasks": ["10"]}, UnknownNameError, "libero_object-00"),
        ({"policy": "zoo:halt"}, InvalidInputError, "a policy that supports this world"),
        ({"observation": "droid"}, UnknownNameError, "state_only"),
    ],
)
def test_a_wrong_choice_is_refused(plan_of, options, error, text):
    with pytest.raises(error, match=text):
        plan_of(**options)


def test_success_is_counted_by_axis_and_paired_with_the_base_suite(plan_of, tmp_path):
    base = evaluate(plan_of("zoo:lexical", suite="libero_object", trials=1), tmp_path / "base", workers=1, envs=1)
    plan = plan_of("zoo:lexical", axes=["layout", "camera", "robot"], variants=2)
    run = evaluate(plan, tmp_path / "plus", workers=1, envs=1)
    found = diagnose_run(run, twins_in=base)
    rates = {axis: found.metric("success_rate", f"axis:{axis}") for axis in ("layout", "camera", "robot")}
    assert {axis: (m.k, m.n) for axis, m in rates.items()} == {"layout": (0, 2), "camera": (4, 4), "robot": (2, 2)}
    assert all(m.low < m.value or m.high > m.value for m in rates.values())
    gaps = {axis: found.metric("illusion_gap", f"axis:{axis}") for axis in rates}
    assert {axis: (m.n, m.value) for axis, m in gaps.items()} == {
        "layout": (2, 1.0),
        "camera": (4, 0.0),
        "robot": (2, 0.0),
    }
    assert "exact exchange of twins" in gaps["layout"].method
    assert {t.label.value for t in found.trials if t.axis == "layout"} == {"lexical_kinematic_shortcut"}
    assert sum("share one twin" in note for note in found.notes) == 1
    assert any("were not run" in note and "layout 2" in note for note in found.notes)
    rows = variation_rows(found)
    assert [(r.task, r.variation, r.trial.n) for r in rows if r.task == "libero_object-00"] == [
        ("libero_object-00", "camera", 2),
        ("libero_object-00", "layout", 1),
        ("libero_object-00", "robot", 1),
    ]
    page = write_report([found], tmp_path / "report", trust=trust_of([found])).read_text()
    assert all(TITLES[axis] in page for axis in rates)
    across = gaps_of(read_suite_runs([base, run], names=["mine", "mine"]))
    assert [(g.world, g.change, g.pairs, g.base - g.changed) for g in across] == [
        ("LIBERO-Plus", "layout", 2, 1.0),
        ("LIBERO-Plus", "camera", 4, 0.0),
        ("LIBERO-Plus", "robot", 2, 0.0),
    ]


def test_pairs_that_share_nothing_get_the_p_value_of_mcnemar():
    generator = np.random.default_rng(0)
    for _ in range(50):
        outcomes = [(bool(a), bool(b)) for a, b in generator.integers(0, 2, (9, 2))]
        table = PairedTable.from_outcomes(outcomes)
        assert exchange_p(outcomes, list(map(str, range(9)))) == pytest.approx(mcnemar_p(table))


def test_pairs_that_share_a_trial_get_the_p_value_of_all_exchanges():
    generator = np.random.default_rng(1)
    for _ in range(20):
        groups = [[bool(x) for x in generator.integers(0, 2, size)] for size in (2, 4, 3, 5)]
        outcomes = [(g[0], second) for g in groups for second in g[1:]]
        shared = [str(i) for i, g in enumerate(groups) for _ in g[1:]]

        def statistic(firsts, groups=groups):
            return sum(len(g) * g[i] - sum(g) for i, g in zip(firsts, groups, strict=True))

        every = [statistic(firsts) for firsts in itertools.product(*(range(len(g)) for g in groups))]
        seen = statistic([0] * len(groups))
        tails = [np.mean([x <= seen for x in every]), np.mean([x >= seen for x in every])]
        assert exchange_p(outcomes, shared) == pytest.approx(min(1.0, 2.0 * min(tails)))


def test_many_variants_of_one_twin_are_no_many_pairs():
    outcomes = [(True, False)] * 50
    assert exchange_p(outcomes, ["one"] * 50) > 0.03
    assert exchange_p(outcomes, [str(i) for i in range(50)]) < 1e-12
    with pytest.raises(InvalidInputError, match="has succeeded in one pair and failed in another"):
        exchange_p([(True, False), (False, False)], ["one", "one"])


POSITION, TURN = np.array([0.65861, 0.0, 1.61037]), np.array([0.638018, 0.30485, 0.30485, 0.638018])


def test_a_camera_is_turned_about_the_middle_of_the_table():
    assert seen_from(POSITION, TURN, CameraView()) == ([0.6586, 0.0, 1.6104], [0.638, 0.3048, 0.3048, 0.638])
    around, _ = seen_from(POSITION, TURN, CameraView(around=90))
    assert around == pytest.approx([0.0, 0.6586, 1.6104], abs=1e-4)
    pivot = np.array([0.0, 0.0, 0.8])
    for view, factor in (
        (CameraView(above=15), 1.0),
        (CameraView(distance=180), 1.8),
        (CameraView(around=30, above=345), 1.0),
    ):
        moved, _ = seen_from(POSITION, TURN, view)
        assert np.linalg.norm(moved - pivot) == pytest.approx(factor * np.linalg.norm(POSITION - pivot), abs=2e-4)
    higher, _ = seen_from(POSITION, TURN, CameraView(above=15))
    assert higher[2] > POSITION[2]
    for view in (CameraView(pan=10), CameraView(tilt=350)):
        still, quaternion = seen_from(POSITION, TURN, view)
        assert still == [0.6586, 0.0, 1.6104]
        angle = 2 * np.degrees(
            np.arccos(abs(np.dot(quaternion, TURN)) / np.linalg.norm(quaternion) / np.linalg.norm(TURN))
        )
        assert angle == pytest.approx(10, abs=0.05)


DIGESTS = ("67fbbeb004f89400", "ceb51760cde3e04a", "6ab4db3739931bbb", "d2426f0df61e0390", "18f1612eb9e82958")
"""Of what the functions of sylvestf/LIBERO-plus@4976dc3 return, with ImageMagick 6.9.11 and scikit-image 0.26."""


@pytest.mark.parametrize("kind", range(5))
def test_noise_is_that_of_libero_plus_to_the_bit(kind):
    rows, columns = np.mgrid[0:256, 0:256]
    image = np.stack([(rows * columns) % 251, (3 * rows + columns) % 256, rows ^ columns], axis=-1).astype(np.uint8)
    digest = hashlib.sha256()
    for strength in range(10):
        np.random.seed(7)  # noqa: NPY002 - LIBERO-Plus draws from the global generator
        noise = Noise(10 * kind + strength + 1)
        digest.update(np.ascontiguousarray(noise.apply(image, noise.draw(256, 256))).tobytes())
        digest.update(np.random.random(1).tobytes())  # noqa: NPY002
    assert digest.hexdigest()[:16] == DIGESTS[kind]


def _archive(path, value):
    pickled = importlib.import_module("pickle").dumps(value, protocol=2)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("states/data.pkl", pickled)
    return path


def test_initial_states_are_read_without_unpickling(tmp_path):
    for shape in ((50, 92), (110,)):
        states = np.random.default_rng(0).normal(size=shape)
        # What torch writes names NumPy's old module.
        assert np.array_equal(initial_states_in(_archive(tmp_path / "states", states)), states)
    for other in (np.zeros(3, np.float32), {"a": 1}, np.zeros((3, 4)).T, [1.0], Path("x"), np.zeros(3, object)):
        with pytest.raises(ValueError, match="expected one float64 array in"):
            initial_states_in(_archive(tmp_path / "states", other))


def test_a_folder_that_does_not_hold_the_assets_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(Installation, "is_installed", property(lambda _: True))
    with pytest.raises(InvalidInputError, match=r"--libero-plus-assets.*scenes, textures, new_objects"):
        plus_command(tmp_path)
    for name in ("scenes", "textures", "new_objects"):
        (tmp_path / name).mkdir()
    assert plus_command(tmp_path)[-1] == str(tmp_path)
    assert plus_command()[-1] == str(world_named("libero_plus").installation.folder)
    monkeypatch.setenv(ASSETS_VARIABLE, str(tmp_path))
    assert plus_command()[-1] == str(tmp_path)
    assert plus_command()[0].startswith(str(world_named("libero").installation.folder))


def test_its_files_are_installed_beside_the_world_that_runs_them(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    ran = []
    monkeypatch.setattr(Installation, "_run", lambda self, command, _: ran.append((self.name, command)))
    monkeypatch.setattr("shutil.which", lambda _: "uv")
    plus, libero = (world_named(name).installation for name in ("libero_plus", "libero"))
    with pytest.raises(MissingDependencyError, match="better worlds install libero_plus"):
        plus.command()
    monkeypatch.setattr("shutil.rmtree", lambda *_, **__: None)  # nothing but the stand-ins of what uv makes
    for world in (libero, plus):
        world.folder.mkdir(parents=True)
    plus.install()
    assert [name for name, _ in ran] == ["libero", "libero", "libero_plus"]
    *_, target, flag, python = ran[-1][1]
    assert (target, flag, python) == (str(plus.folder), "--python", str(libero.folder / "bin" / "python"))
    assert {"--no-deps", "--require-hashes"} <= set(ran[-1][1])


@pytest.mark.parametrize(
    ("suite", "option"),
    [
        ("better60", {"variants": 3}),
        ("libero_object", {"axes": ("camera",)}),
        ("libero_object", {"variants": 3}),
        ("calvin", {"variants": 3}),
    ],
)
def test_its_options_are_refused_for_other_suites(suite, option):
    from betterbench.cli.verbs.evaluate import TrialOptions, WorldOptions, evaluate_command

    with pytest.raises(InvalidInputError, match=r"this option applies only to LIBERO-Plus\..*libero_plus_spatial"):
        evaluate_command(policy="noop", chosen=TrialOptions(suite=suite), world=WorldOptions(**option))


def test_better_list_suites_shows_them(capsys):
    from betterbench.cli.verbs.listing import list_command

    list_command("suites")
    shown = capsys.readouterr().out
    assert "libero_plus_spatial" in shown
    assert "2,402" in shown
