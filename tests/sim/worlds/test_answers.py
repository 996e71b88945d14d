"""Answers of policy servers in other worlds: what is played is what the field's own client would play."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.looping import each
from tests.sim.worlds import clients_answers

from betterbench.errors import InvalidInputError
from betterbench.interface import Observation
from betterbench.interface.actions import PLAYED_IN, action_space
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.answers import AnswerPart, AnswerRule
from betterbench.policies.conventions.in_calvin import CALVIN_PRESETS
from betterbench.policies.conventions.libero import BASES_M
from betterbench.policies.conventions.presets import LEROBOT_SO101, PRESETS, adapter_of
from betterbench.policies.kinds import kind_of, read_address
from betterbench.sim.worlds.calvin import ChainScene
from betterbench.sim.worlds.calvin.simulator import CalvinSimulator

BORDERS = (-1.0, -1e-3, 0.0, 0.2, 0.5, np.nextafter(0.5, 1.0), 0.79, 0.8, 0.81, 1.0)
"""Numbers for the gripper, with each at which a client of the field decides."""

SCHEMES = {
    "openpi": "openpi",
    "gr00t": "gr00t",
    "being": "being-h",
    "vla": "vla-eval",
    "starvla": "starvla",
    "openvla": "http",
    "x": "http",
    "dexbotic": "http",
    "lerobot": "lerobot",
}


def seen():
    """Return an observation of CALVIN, as far as an answer may depend on it."""
    quaternion = np.array([0.0, 1.0, 0.0, 0.0])
    native = {"gripper_command": np.array([1.0]), "gripper_command_closed": np.array([0.0])}
    return Observation(
        "go", 0, {}, np.zeros(7), np.zeros(7), np.array([0.1, 0.2, 0.5]), quaternion, 0.08, {}, {}, native
    )


def spoken_to(name, world):
    """Return the adapter of a preset in a world, as the address of its kind of server gives it."""
    scheme = SCHEMES[name.partition("_")[0]]
    place = "folder" if scheme == "lerobot" else "//host"
    return adapter_of(read_address(f"{scheme}:{place}?preset={name}", world=world))


def rows_for(adapter, count, seed):
    """Return rows of an answer, all its keys side by side, whose gripper goes through the borders, and by key."""
    draw = np.random.default_rng(seed)
    rows = draw.uniform(-0.9, 0.9, (count, sum(adapter.answer.columns.values())))
    at, grip = 0, None
    columns = {}
    for key, width in adapter.answer.columns.items():
        columns[key] = slice(at, at + width)
        at += width
    place = 0
    for part in adapter.answer.parts:
        size = part.size or adapter.answer._natural(part.kind)
        grip = place if part.kind == "gripper" else grip
        place += size
    rows[:, grip] = np.resize(BORDERS, count)
    reply = {}
    for key, where in columns.items():
        found = reply
        for name in key[:-1]:
            found = found.setdefault(name, {})
        found[key[-1]] = rows[:, where]
    return rows, reply


@each("name", clients_answers.LIBERO)
def test_libero_is_given_what_the_client_of_the_field_gives_it(name):
    adapter = spoken_to(name, "libero")
    rows, reply = rows_for(adapter, 40, 3)
    played = adapter.actions(reply, seen())
    given = np.array([clients_answers.LIBERO[name](row) for row in rows])
    if name == "x_vla":  # a rotation vector may go the other way round
        assert np.allclose(
            (Rotation.from_rotvec(played[:, 3:6]).inv() * Rotation.from_rotvec(given[:, 3:6])).magnitude(), 0
        )
        played, given = np.delete(played, range(3, 6), 1), np.delete(given, range(3, 6), 1)
    np.testing.assert_array_equal(played, given)


class CalvinEnv:
    """What is given to calvin_env."""

    def __init__(self):
        self.given, self.cameras = [], []

    def step(self, action):
        self.given.append(np.concatenate([np.ravel(part) for part in action]))
        return {}, 0, False, {}


@pytest.mark.parametrize("name", clients_answers.CALVIN)
def test_calvin_is_given_what_the_client_of_the_field_gives_it(name, monkeypatch):
    adapter = spoken_to(name, "calvin")
    rows, reply = rows_for(adapter, 40, 4)
    space = action_space(adapter.answer.space)
    start = np.array([0.02, -0.2, 0.57, 3.09, -0.03, 1.5])
    simulator, env = CalvinSimulator.__new__(CalvinSimulator), CalvinEnv()
    monkeypatch.setattr(CalvinSimulator, "_row", lambda *_: ({}, {}))
    scene = SimpleNamespace(action_space=space, _images=False, draws_depth=False, _commanded=start.copy())
    simulator._env, simulator._cameras = env, []
    simulator._split = ChainScene._shown.fget(scene)["split"]
    for action in adapter.actions(reply, seen()):
        simulator.step(ChainScene._played(scene, space.clip(action)), look=False)
    last = start.copy()
    given = np.array([clients_answers.CALVIN[name](row, last) for row in rows])
    played = np.array(env.given)
    if name == "x_vla_calvin":  # a quaternion and its negative are one rotation
        sign = np.sign(np.sum(played[:, 3:7] * given[:, 3:7], axis=1, keepdims=True))
        played[:, 3:7] *= sign
    exact = name not in ("x_vla_calvin", "vla_eval_calvin_absolute")
    np.testing.assert_allclose(played, given, rtol=0, atol=0 if exact else 3e-7)
    np.testing.assert_array_equal(played[:, -1], given[:, -1])


def test_every_preset_of_another_world_is_compared_with_a_client():
    translating = {name for name in PRESETS if name.endswith(tuple(f"_{suite}" for suite in BASES_M))}
    ours = {"native", "openpi_droid", "gr00t_new_embodiment", "gr00t_oxe_widowx", "gr00t_oxe_droid", *LEROBOT_SO101}
    assert PRESETS.keys() - CALVIN_PRESETS.keys() - translating - ours == clients_answers.LIBERO.keys()
    assert CALVIN_PRESETS.keys() == clients_answers.CALVIN.keys()


USUAL = {
    "openpi": "native",
    "gr00t": "gr00t_new_embodiment",
    "being-h": "being_h_libero",
    "vla-eval": "vla_eval",
    "starvla": "starvla",
}


def space_in_calvin(address):
    return kind_of(address).space_in_world(read_address(address, world="calvin"))


def test_the_usual_preset_of_each_server_is_that_of_its_client_in_the_world():
    usual = {}
    for scheme, name in USUAL.items():
        for world in ("libero", "calvin"):
            address = read_address(f"{scheme}://host", world=world)
            found = adapter_of(address, PRESETS[name])
            assert kind_of(f"{scheme}://host").space_in_world(address) == found.answer.space
            assert found.answer.space in PLAYED_IN[world]
            usual[scheme, world] = (found.name, found.answer.gripper)
    assert usual["starvla", "libero"] == ("starvla", "open_fraction")
    assert usual["starvla", "calvin"] == ("starvla_calvin", "open_positive")
    assert usual["being-h", "libero"] == ("being_h_libero", "open_linear")
    assert usual["being-h", "calvin"] == ("being_h_calvin", "open_linear")
    assert usual["gr00t", "libero"] == ("gr00t_libero_panda", "open_sign")
    assert usual["gr00t", "calvin"] == ("gr00t_calvin", "open_positive")
    assert usual["vla-eval", "calvin"] == ("vla_eval_calvin", "open_positive")


def test_in_our_own_scenes_a_preset_is_what_it_was():
    for name in ("starvla", "being_h_libero", "vla_eval", "openvla", "x_vla"):
        given = "&send.domain_id=3" if name == "x_vla" else ""
        scheme = SCHEMES[name.partition("_")[0]]
        assert adapter_of(read_address(f"{scheme}://host?preset={name}{given}")).answer == PRESETS[name].answer


@pytest.mark.parametrize("given", [{}, {"translation_unit_m": 0.02, "rotation": "rpy", "gripper": "open_positive"}])
def test_an_adapter_that_answers_calvins_actions_passes_them_on(given, tmp_path):
    parts = [{"key": "a", "kind": kind} for kind in ("translation", "rotation", "gripper")]
    form = {
        "views": [],
        "states": [],
        "instruction": {"key": "prompt"},
        "answer": {"space": "calvin_relative", "parts": parts, **given},
    }
    file = tmp_path / "mine.json"
    file.write_text(__import__("json").dumps(form), encoding="utf-8")
    adapter = adapter_of(read_address(f"openpi://host?adapter={file}", world="calvin"))
    rows = np.array([[0.3, -0.2, 1.8, 0.1, 0.7, -0.4, 1.0], [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, -1.0]])
    np.testing.assert_array_equal(adapter.actions({"a": rows}, seen()), rows)
    assert adapter.control_rate_hz == 30.0


def test_units_and_polarity_of_an_adapter_are_turned_into_calvins():
    parts = tuple(AnswerPart(("a",), kind) for kind in ("translation", "rotation", "gripper"))
    rule = AnswerRule(
        "calvin_relative", parts, translation_unit_m=1.0, rotation_unit_rad=1.0, gripper="closed_fraction"
    )
    row = np.array([0.02, 0.0, -0.01, 0.05, 0.0, 0.1, 1.0])
    adapter = Adapter("mine", (), (), PRESETS["native"].instruction, rule)
    np.testing.assert_allclose(adapter.actions({"a": row}, seen())[0], [1.0, 0.0, -0.5, 1.0, 0.0, 2.0, -1.0])
    with pytest.raises(
        InvalidInputError,
        match=r"calvin_relative adds angles to the last pose, but axis_angle does not consist of angles",
    ):
        AnswerRule("calvin_relative", parts, rotation="axis_angle")


def test_an_address_says_that_answers_are_calvins():
    adapter = adapter_of(
        read_address("lerobot:folder?action_space=calvin_relative", world="calvin"), PRESETS["lerobot"]
    )
    row = np.array([0.3, 0.0, 0.0, 0.1, 0.0, 0.0, -1.0])
    np.testing.assert_array_equal(adapter.actions({"action": row}, seen())[0], row)
    assert space_in_calvin("starvla://host") == "calvin_relative"
    assert space_in_calvin("http://host/act?preset=x_vla") == "calvin_absolute_quaternion"
    assert space_in_calvin("python:mine.py:Mine") is None


@pytest.mark.parametrize(
    ("address", "world", "text"),
    [
        (
            "openpi://host?preset=openpi_droid",
            "calvin",
            r"openpi_droid returns actions in joint_delta, .* Use preset=NAME \(starvla_calvin",
        ),
        (
            "being-h://host?preset=being_h_libero",
            "calvin",
            r"returns actions in ee_delta, which CALVIN does not support",
        ),
        ("starvla://host?preset=starvla_calvin", "", r"returns actions in calvin_relative, .* --suite calvin"),
        (
            "starvla://host?preset=starvla_calvin",
            "libero",
            r"returns actions in calvin_relative, which LIBERO does not support",
        ),
        (
            "vla-eval://host?preset=vla_eval_absolute",
            "",
            r"returns actions in libero_absolute, .* --suite libero_object",
        ),
        ("openpi://host?preset=openpi_droid", "libero", r"which LIBERO does not support"),
    ],
)
def test_a_preset_of_another_world_is_refused_with_one_that_exists(address, world, text):
    with pytest.raises(InvalidInputError, match=text):
        adapter_of(read_address(address, world=world))
