"""What messages advise exists, and is accepted: no message sends its reader to another one that refuses the advice."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.looping import each

import betterbench
from betterbench.cli.main import VERBS
from betterbench.errors import BetterError, HandshakeError, InvalidInputError
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface import EpisodeStart, observation_spec
from betterbench.interface.actions import ACTION_SPACES, EE_DELTA
from betterbench.policies.address import CAMERA, CONSTANT
from betterbench.policies.clients.remote import AdaptedPolicy, check_start
from betterbench.policies.conventions.handshake import Declaration
from betterbench.policies.conventions.presets import PRESETS, adapter_of, presets_in
from betterbench.policies.kinds import KINDS, read_address
from betterbench.sim.worlds import all_worlds, world_named

SOURCES = Path(betterbench.__path__[0])
ADVISING = ("policies", "sim/worlds", "evaluation/planning", "evaluation/trials", "evaluation/preflight")
OPTIONS = {option.name for kind in KINDS.values() for option in kind.form.options if not option.takes_key}
SERVERS = [kind.name for kind in KINDS.values() if kind.form.transport is not None]
EACH_PRESET = each("preset", PRESETS)


class AcceptedError(Exception):
    """The plan went on to ask the world: nothing about the policy is refused."""


def _accept(*_, **__):
    raise AcceptedError


WORLDS = pytest.mark.parametrize("world", [world.name for world in all_worlds() if world.dialect])


@pytest.fixture(autouse=True)
def _worlds_that_only_accept(monkeypatch):
    for world in all_worlds():
        monkeypatch.setattr(type(world), "plan", _accept)


def addresses_advised(address: str, message: str) -> list[str]:
    """Return the addresses that a message about an address advises to give in its place."""
    name, _, query = address.partition("?")
    rest = [part for part in query.split("&") if part and not part.startswith("preset=")]
    listed = re.search(r"(?:[Gg]ive|[Uu]se) preset=NAME \(([^)]*)\)", message)
    named = re.findall(r"(?:[Gg]ive|[Uu]se) preset=([a-z0-9_]+)", message)
    presets = [*(listed[1].split(", ") if listed else []), *named]
    constants = [f"{key}=1" for key in re.findall(r"Add (send\.[a-z_]+)=VALUE", message)]
    if constants:
        return ["&".join((f"{name}?{query}", *constants))]
    return ["&".join((f"{name}?preset={preset}", *rest)) for preset in presets]


@functools.cache  # many messages advise the same addresses
def refusal(world: str, policy: str) -> str:
    """Return why a policy is refused, or an empty text if it is not."""
    try:
        make_world_plan(policy, suite=next(iter(world_named(world).facts.suites)))
    except AcceptedError:
        return ""
    except InvalidInputError as error:
        return str(error)
    raise AssertionError("a plan was made of nothing")


@WORLDS
@EACH_PRESET
def test_every_preset_is_taken_by_a_world_or_the_message_leads_to_one_that_is(world, preset):
    for scheme in SERVERS:
        follow(world, f"{scheme}://127.0.0.1:9?preset={preset}&horizon=3")


def follow(world, address):
    left, seen = [address], set()
    while left:
        address = left.pop()
        message = refusal(world, address)
        if not message:
            continue
        seen.add(address)
        advised = addresses_advised(address, message)
        assert advised or "Give a python: policy for" in message, message
        assert all(read_address(a).options.get("preset") in PRESETS for a in advised), message
        left += advised
        assert len(seen) == 1, f"the advice is refused: {message}"


@pytest.mark.parametrize(
    ("preset", "layout"),
    [
        ("starvla_libero_object", "starvla"),
        ("starvla_state_libero_10", "starvla_state"),
        ("openvla_libero_spatial", "openvla"),
        ("openvla_oft_libero_goal", "openvla_oft"),
        ("vla_eval_libero_study", "vla_eval"),
        ("openpi_libero_90", "openpi_libero"),
        ("gr00t_libero_panda_living_room", "gr00t_libero_panda"),
    ],
)
def test_a_preset_that_translates_is_refused_with_its_layout(preset, layout):
    message = refusal("libero", f"openpi://127.0.0.1:9?preset={preset}")
    assert f"the preset {preset} converts betterbench's own scenes" in message
    assert message.endswith(f"Use preset={layout}.")
    assert refusal("libero", f"openpi://127.0.0.1:9?preset={layout}") == ""


def test_a_world_is_not_played_in_another_space():
    message = refusal("libero", "openpi://127.0.0.1:9?preset=openpi_droid")
    assert "openpi_droid returns actions in joint_delta, which LIBERO does not support. Use preset=NAME (" in message
    assert refusal("libero", "http://127.0.0.1:9/act?preset=x_vla") == ""
    assert refusal("libero", "gr00t://127.0.0.1:9") == ""
    assert refusal("libero", "lerobot:some/checkpoint") == ""


@each("preset", presets_in(""))
@each("space", ACTION_SPACES)
def test_the_action_space_that_a_client_advises_is_taken(preset, space):
    class Client(AdaptedPolicy):
        adapter = adapter_of(read_address(f"http://h/act?preset={preset}&send.domain_id=3"))
        server = Declaration("the server")

        def asked(self, name):
            check_start(self.adapter, EpisodeStart("x", 0, name), "the server")
            cameras = tuple(SimpleNamespace(name=camera) for camera in self.adapter.cameras)
            seen = SimpleNamespace(cameras=cameras)
            self.check(space=name, observation=seen, rate_hz=self.adapter.control_rate_hz)

    client = Client()
    for asking in (client.asked, lambda name: client.check(space=name, observation=_all_cameras(), rate_hz=20.0)):
        try:
            asking(space)
        except HandshakeError as error:
            advised = re.findall(r"Use --action-space ([a-z_]+) in a suite of betterbench", str(error))
            if not advised:
                continue  # a camera that the observation does not have
            client.asked(*advised)


def _all_cameras():
    return observation_spec("default")


@pytest.mark.parametrize("scheme", SERVERS)
def test_the_presets_that_are_offered_where_none_is_named_exist(scheme):
    with pytest.raises(InvalidInputError) as caught:
        adapter_of(read_address(f"{scheme}://127.0.0.1:9"))
    listed = re.search(r"\?preset=NAME \(([^;]*); trained on LIBERO: ([^)]*)\)", str(caught.value))
    names = listed[1].split(", ")
    for name in names:
        try:
            adapter_of(read_address(f"{scheme}://127.0.0.1:9?preset={name}"))
        except BetterError as error:
            (advised,) = addresses_advised(f"{scheme}://127.0.0.1:9?preset={name}", str(error))
            if scheme != "gr00t":  # knows no constants, and so not this layout
                adapter_of(read_address(advised))
    for name in listed[2].split(", "):
        for suite in ("spatial", "object", "goal", "10", "90", "study", "living_room"):
            assert name.replace("SUITE", suite) in PRESETS


# --------------------------------------------------------------------------------------------- what is advised in words


def texts_of(file: Path) -> list[str]:
    """Return the texts in the code of a file, without its docstrings; what is filled in is "{}"."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    bare = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            found.append("".join(str(v.value) if isinstance(v, ast.Constant) else "{}" for v in node.values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in bare:
            found.append(node.value)
    return found


@functools.cache
def texts() -> list[tuple[str, str]]:
    """Return the texts of several words of the packages that advise, with the names of their files."""
    files = [file for name in ADVISING for file in sorted((SOURCES / name).rglob("*.py"))]
    return [(file.name, text) for file in files for text in texts_of(file) if " " in text]


@functools.cache
def flags() -> set[str]:
    """Return the names of all fields and arguments of the command line, as flags."""
    nodes = [
        node
        for file in (SOURCES / "cli").rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
    ]
    fields = [n.target.id for n in nodes if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)]
    return {name.replace("_", "-") for name in (*fields, *(n.arg for n in nodes if isinstance(n, ast.arg)))}


NOT_OURS = {"upgrade", "key", "device", "ahead", "size", "ee_offset", "python", "init", "recursive"}
"""Of pip, uv and git, and where a message repeats what it was given."""


def advised_in_words(pattern: str) -> set[tuple[str, str]]:
    return {(name, word) for name, text in texts() for word in re.findall(pattern, text)}


def test_every_option_that_is_advised_exists():
    found = advised_in_words(r"\b([a-z][a-z_]*)=(?:[A-Z]+\b|[a-z0-9.]+)(?![:(])")
    assert len(found) > 12
    assert {(f, w) for f, w in found if w not in OPTIONS | NOT_OURS} == set()
    prefixes = advised_in_words(r"\b((?:camera|send)\.)(?:KEY|\{\})")
    assert {word for _, word in prefixes} <= {CAMERA.name, CONSTANT.name}


def test_every_flag_that_is_advised_exists():
    found = advised_in_words(r"(?<![\w-])--([a-z][a-z-]*)")
    assert {("remote.py", "allow-changed-policy"), ("handshake.py", "action-space")} <= found
    assert {(f, w) for f, w in found if w not in flags() | NOT_OURS} == set()


def test_every_verb_that_is_advised_exists():
    found = advised_in_words(r"(?:[Rr]un|[Gg]ive|as|with|:) `?better ([a-z][a-z-]*)")
    assert {("installation.py", "worlds"), ("lerobot.py", "serve"), ("adapter.py", "doctor")} <= found
    assert {(f, w) for f, w in found if w not in VERBS} == set()


def test_every_preset_that_is_advised_in_words_exists():
    found = advised_in_words(r"preset=([a-z][a-z0-9_]*)")
    assert {(f, w) for f, w in found if w not in PRESETS} == set()


def test_the_space_of_libero_is_the_one_that_its_presets_are_compared_with():
    assert refusal("libero", "openpi://127.0.0.1:9?preset=openpi_libero") == ""
    assert PRESETS["openpi_libero"].answer.space == EE_DELTA.name
