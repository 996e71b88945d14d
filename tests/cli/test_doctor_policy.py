"""`better doctor --policy P`: conventions, one answer, and exactly the images that the policy is shown."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from betterbench.cli.main import main
from betterbench.episodes import Observer
from betterbench.evaluation import open_server, run_preflight
from betterbench.evaluation.preflight.view import PreflightView
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.conventions.presets import OPENPI_LIBERO
from betterbench.policies.serving.server import PolicyServer
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

OUTLINE = (255, 64, 160)
TRIAL = TrialId("morning_coffee", "train1", 0)
SCENE = ("--task", "morning_coffee", "--quality", "fast", "--no-proof")


class Pushes:
    """Answers the same chunk to everything, and keeps what it was shown."""

    seen: list = []  # noqa: RUF012 - set anew by each test
    actions = np.array([[0.2, -0.4, -0.6, 0.0, 0.0, 0.2, 1.0]] * 5)

    def answer(self, request):
        self.seen.append(dict(request))
        return {"actions": self.actions}

    def close(self):
        pass


@pytest.fixture
def pushes():
    Pushes.seen = []
    Pushes.actions = np.array([[0.2, -0.4, -0.6, 0.0, 0.0, 0.2, 1.0]] * 5)
    with PolicyServer(Pushes, metadata={}, port=0) as server:
        yield server


def run(capsys, *arguments):
    status = main(["doctor", *arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def pixels(file):
    with Image.open(file) as sheet:
        return np.asarray(sheet.convert("RGB"))


@pytest.mark.render
def test_the_images_are_exactly_those_that_the_policy_gets(capsys, tmp_path, pushes):
    address = f"{pushes.address}?preset=openpi_libero&fit=crop"
    out = tmp_path / "sheet.png"
    status, text, err = run(capsys, "--policy", address, *SCENE, "--out", str(out))
    assert (status, len(Pushes.seen)) == (0, 6)
    for expected in ("openpi_libero", "observation/wrist_image", "224 x 224", "5 x 7 in ee_delta", "ms median"):
        assert expected in text.replace("\n", " ")
    assert str(out) in err.replace("\n", "")
    sheet = pixels(out)
    for key in ("observation/image", "observation/wrist_image"):
        shown = Pushes.seen[0][key]
        assert shown.shape == (224, 224, 3)
        assert contains(sheet, shown.repeat(2, axis=0).repeat(2, axis=1))
    assert (sheet == OUTLINE).all(axis=2).sum() > 200


def contains(sheet, image):
    """Tells whether a image stands somewhere in a sheet, pixel by pixel."""
    height, width = image.shape[:2]
    first = (sheet[: len(sheet) - height + 1, : sheet.shape[1] - width + 1] == image[0, 0]).all(axis=2)
    return any(np.array_equal(sheet[y : y + height, x : x + width], image) for y, x in np.argwhere(first))


@pytest.mark.render
def test_json_holds_the_same(capsys, tmp_path, monkeypatch, pushes):
    monkeypatch.chdir(tmp_path)
    address = f"{pushes.address}?preset=openpi_libero"
    status, text, err = run(capsys, "--policy", address, *SCENE, "--json")
    assert status == 0, err
    told = json.loads(text)
    assert told["trial"] == {"task": "morning_coffee", "condition": "train1", "seed": 0}
    assert [p["key"] for p in told["images"]] == ["observation/image", "observation/wrist_image"]
    assert told["adapter"] == OPENPI_LIBERO.to_json()
    assert told["actions"] == Pushes.actions.tolist()
    assert told["latency_s"]["requests"] == 5
    assert 0.0 < told["latency_s"]["p50"] <= told["latency_s"]["max"]
    state = np.concatenate([told["state"][f"observation/state: {part}"] for part in OPENPI_LIBERO.states[0].parts])
    np.testing.assert_allclose(state, Pushes.seen[0]["observation/state"], atol=1e-6)
    conventions = {c["name"]: c for c in told["conventions"]}
    assert conventions["gripper"] == {"name": "gripper", "ours": "close_positive", "theirs": "", "differs": False}
    made = [p.name for p in tmp_path.iterdir()]
    assert made == [f"doctor-openpi-127.0.0.1-{pushes.port}-preset-openpi-libero.png"]


@pytest.mark.render
def test_what_nobody_declares_is_told(capsys, tmp_path):
    file = tmp_path / "assuming.py"
    file.write_text(
        "from betterbench.interface import PolicyInfo\n"
        "from betterbench.policies import Noop\n"
        "class Assuming(Noop):\n"
        "    info = PolicyInfo('assuming', metadata={'assumed': 'its actions are meters'})\n",
        encoding="utf-8",
    )
    status, text, err = run(capsys, "--policy", f"python:{file}:Assuming", *SCENE, "--out", str(tmp_path / "a.png"))
    assert status == 0, err
    assert "its actions are meters" in text


@pytest.mark.render
@pytest.mark.parametrize("policy", [pytest.param("noop", marks=pytest.mark.slow), "expert"])
def test_a_local_policy_is_drawn_too(capsys, tmp_path, policy):
    out = tmp_path / "sheet.png"
    status, text, _ = run(capsys, "--policy", policy, *SCENE, "--out", str(out))
    assert status == 0
    assert "1 x 7 in ee_delta" in text
    sheet = pixels(out)
    assert sheet.shape[1] == 1400
    assert (sheet == OUTLINE).all(axis=2).any()


@pytest.mark.render
def test_a_served_expert_declares_what_we_do():
    with open_server("expert", port=0) as server:
        told = []
        found = run_preflight(server.address, TRIAL, quality="fast", on_conventions=told.extend)
    assert {c.name for c in told if c.ours and c.theirs} >= {"preset", "action space", "action scale", "rate hz"}
    assert not [c for c in told if c.differs]
    assert found.actions.shape == (8, 7)
    assert not found.shown


@pytest.mark.render
def test_conventions_that_differ_are_shown_before_the_run_is_refused(capsys, tmp_path, monkeypatch, pushes):
    monkeypatch.chdir(tmp_path)
    address = f"{pushes.address}?preset=openpi_libero"
    status, text, err = run(capsys, "--policy", address, *SCENE, "--action-space", "ee_pose")
    assert status == 2
    assert "ee_pose" in text
    assert "ee_delta" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--policy", "exprt"), "Did you mean 'expert'"),
        (("--policy", "replay:runs/x"), "a replay policy only repeats recorded actions"),
        (("--policy", "noop", "--task", "fast_fod"), "fast_food"),
        (("--policy", "openpi://127.0.0.1:1?patience=0.1&preset=native"), "could not be reached"),
    ],
)
def test_bad_input_is_one_clear_error_with_status_2(capsys, tmp_path, monkeypatch, arguments, text):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *arguments)
    assert status == 2
    assert not out
    assert text in err.replace("\n", " ")
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


@pytest.mark.render
@pytest.mark.parametrize("actions", [np.full((3, 7), np.nan), np.zeros((0, 7)), np.zeros((3, 6))])
def test_a_bad_answer_is_one_clear_error(capsys, tmp_path, monkeypatch, pushes, actions):
    monkeypatch.chdir(tmp_path)
    Pushes.actions = actions
    status, _, err = run(capsys, "--policy", f"{pushes.address}?preset=openpi_libero", *SCENE)
    assert status == 2
    assert "error:" in err
    assert "Traceback" not in err


@pytest.mark.render
def test_actions_that_a_run_would_clip_are_counted(capsys, tmp_path, monkeypatch, pushes):
    monkeypatch.chdir(tmp_path)
    Pushes.actions = np.vstack([Pushes.actions, 30.0 * Pushes.actions])
    status, text, _ = run(capsys, "--policy", f"{pushes.address}?preset=openpi_libero", *SCENE)
    assert status == 0
    assert "5 of 10 actions would be clipped in a run" in " ".join(text.split())


def test_a_chunk_that_is_too_short_for_asking_ahead_is_named_before_a_run_breaks_on_it(
    capsys, tmp_path, monkeypatch, pushes
):
    monkeypatch.chdir(tmp_path)
    status, _, err = run(capsys, "--policy", f"{pushes.address}?preset=openpi_libero&horizon=8&ahead=5", *SCENE)
    assert status == 2
    assert "a chunk has 5 actions" in " ".join(err.split())


def test_later_answers_count_as_well(capsys, tmp_path, monkeypatch, pushes):
    monkeypatch.chdir(tmp_path)
    good = Pushes.answer
    broken = np.full(7, np.nan)
    monkeypatch.setattr(
        Pushes, "answer", lambda self, request: {"actions": broken} if len(self.seen) > 2 else good(self, request)
    )
    status, _, err = run(capsys, "--policy", f"{pushes.address}?preset=openpi_libero", *SCENE)
    assert status == 2
    assert "x = nan" in err.replace("\n", " ")


def test_the_arrow_begins_at_the_gripper_and_points_where_the_action_leads(tmp_path):
    from betterbench.report.pages.preflight_sheet import arrow_factor, write_preflight_sheet

    start, aim = np.array([60.0, 40.0]), np.array([60.0, 70.0])
    view = PreflightView(
        title="a policy",
        trial="a trial",
        prompt="Pack it.",
        shown=(),
        no_images="No images.",
        state=(),
        facts=(),
        latency="",
        scene=np.zeros((300, 300, 3), np.uint8),
        path=np.array([start, start]),
        aim=aim,
        turn="no turn",
    )
    assert arrow_factor(start, aim) == 5
    sheet = pixels(write_preflight_sheet(view, tmp_path / "sheet.png"))
    rows, columns = np.nonzero((sheet == 0).all(axis=2))
    drawn = sheet[rows.min() : rows.min() + 300, columns.min() : columns.min() + 300]
    assert drawn.shape == (300, 300, 3)
    pink = (drawn == OUTLINE).all(axis=2)
    rows, columns = np.nonzero(pink)
    assert pink[40, 60]
    # 30 pixels are drawn five times as long, from 40 to 190.
    assert abs(columns.mean() - 60.0) < 1.5
    assert rows.min() == pytest.approx(34, abs=4)
    assert rows.max() == pytest.approx(190, abs=4)


@pytest.mark.render
def test_joint_actions_leave_the_scene_as_it_was(monkeypatch):
    """The way of a joint action is found by trying; what is drawn starts from reset all the same."""
    from betterbench.evaluation.preflight import view as preflight_view
    from betterbench.interface.actions import JOINT_DELTA

    found = resolve_condition(TRIAL.task, TRIAL.condition)
    scene = Scene(found.task, found.condition, seed=0, action_space=JOINT_DELTA, quality=quality_preset("fast"))
    before = Observer(observation_spec("state_only")).observe(scene, scene.reset())
    action = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    aim = preflight_view._aim(action, scene)
    after = Observer(observation_spec("state_only")).observe(scene, scene.state())
    np.testing.assert_array_equal(before.joint_positions, after.joint_positions)
    assert np.linalg.norm(np.asarray(aim) - before.ee_position) > 0.01
    assert EE_DELTA.name not in scene.action_space.name


@pytest.mark.render
@pytest.mark.parametrize(("length", "told"), [(1, False), (5, True)])
def test_where_a_whole_answer_ends_is_said_of_chunks_alone(pushes, length, told):
    """After one action the arm still lags behind, so its place contradicts how far the action moves."""
    from betterbench.evaluation.preflight.view import preflight_view

    Pushes.actions = Pushes.actions[:length]
    found = run_preflight(f"{pushes.address}?preset=openpi_libero", TRIAL, quality="fast")
    named = [name for name, _ in preflight_view(found).facts]
    assert ("whole answer" in named) is told
    assert "moves" in named
