"""Answers of foreign simulators in which any part is of another type: read as before, or refused in one line."""

from __future__ import annotations

import copy
import os
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from betterbench.errors import BetterError, PremiseError, one_line
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface.actions import CALVIN_RELATIVE, EE_DELTA
from betterbench.sim.worlds import WorldProcesses
from betterbench.sim.worlds.installation import start_code
from betterbench.sim.worlds.premises import check_premises
from betterbench.sim.worlds.process import WorldError, WorldProcess

MOST = int(os.environ.get("BETTERBENCH_MUTATIONS", "80"))
"""Mutations of each kind of answer; all of them with a large number."""
ABSENT = object()
VALUES = (None, True, 5, -1, 2.5, 10**400, 1e308, "x", "x" * 300_000, "\x1b[31m\nred", [], [[]], {}, {"a": {}}, ABSENT)
FORMS = (
    lambda _: None,
    lambda a: a[:-1] if a.ndim else a,
    lambda a: a[None],
    lambda a: a.astype(np.float32),
    lambda a: a.astype(np.int64) if a.dtype != np.int64 else a.astype(np.uint8),
    lambda a: np.full(a.shape, np.nan),
    np.zeros_like,
    lambda a: np.full_like(a, 1) if a.dtype == bool else np.full_like(a, 99),
    lambda a: np.zeros((0,) * max(a.ndim, 1), a.dtype),
)


def places(form, at=()):
    """Yields the place of every part of a document; of a list, of its first and its last entry."""
    if at:
        yield at
    if isinstance(form, dict):
        for name in form:
            yield from places(form[name], (*at, name))
    elif isinstance(form, list) and form:
        for number in {0, len(form) - 1}:
            yield from places(form[number], (*at, number))


def changed(form, place, value):
    found = copy.deepcopy(form)
    *path, last = place
    inner = found
    for step in path:
        inner = inner[step]
    if value is ABSENT:
        del inner[last]
    else:
        inner[last] = value
    return found


def mutations(answer):
    document, arrays = answer
    for place in places(document):
        for value in VALUES:
            yield changed(document, place, value), arrays
    for name, array in arrays.items():
        for form in FORMS:
            other = form(array)
            rest = {other_name: a for other_name, a in arrays.items() if other_name != name}
            yield document, rest if other is None else rest | {name: other}


def drawn(answer, seed):
    every = list(mutations(answer))
    chosen = np.random.default_rng(seed).permutation(len(every))[:MOST]
    return [every[i] for i in sorted(chosen)]


@contextmanager
def answering(monkeypatch, do, answer):
    """Lets every request of a kind be answered so."""
    real = WorldProcess._ask
    with monkeypatch.context() as patch:
        patch.setattr(
            WorldProcess,
            "_ask",
            lambda self, request, arrays, limit: answer if request["do"] == do else real(self, request, arrays, limit),
        )
        yield


def refused(act):
    """Returns whether it is refused, in one line that steers no terminal."""
    try:
        act()
    except (WorldError, PremiseError) as problem:
        text = str(problem)
        assert one_line(text, most=1500) == text
        return True
    except BetterError as problem:
        raise AssertionError(f"{type(problem).__name__} blames another: {problem}") from problem
    return False


def genuine(command, *requests):
    with WorldProcess(command) as process:
        for request, arrays in requests:
            answer = process._ask(request, arrays, 60.0)
    return answer


def follow(scene, begin):
    if begin:
        scene.reset()
    scene.step(np.array([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    for step in (scene.state, scene.truth, scene.native, scene.simulator_state, scene.images, scene.files):
        step()
    return scene.content_hash, scene.engine, scene.relation_names, scene.subgoal_names


@pytest.fixture(scope="module")
def libero_world(fake_command):
    return make_world_plan("noop", suite="libero_object", command=fake_command, tasks=["3"], trials=1).world


@pytest.fixture
def libero(fake_command, libero_world):
    processes = WorldProcesses(fake_command)
    scene = libero_world.open_scene(
        processes, task="libero_object-03", condition="base", seed=1, action_space=EE_DELTA, images=True
    )
    yield scene
    scene.close(well=False)
    processes.close()


@pytest.mark.parametrize("do", ["start", "step"])
def test_answers_of_libero(libero, fake_command, monkeypatch, do):
    start = {"do": "start", "suite": "libero_object", "task": 3, "state": 1, "images": True}
    requests = [(start, {}), ({"do": "step", "look": True}, {"action": np.zeros(7)})]
    answer = genuine(fake_command, *requests[: 1 + (do == "step")])
    libero.reset()
    assert not refused(lambda: follow(libero, begin=True))
    count = 0
    for number, other in enumerate(drawn(answer, 1)):
        with answering(monkeypatch, do, other):
            libero.draw_next(wanted=number % 2 == 0)
            count += refused(lambda: follow(libero, begin=do == "start"))
    assert count > 10


class _Same(WorldProcesses):
    """One process for all episodes: starting one takes a second, and what it keeps of an episode does not matter."""

    def __init__(self, command):
        super().__init__(command)
        self.process = WorldProcess(command)

    def take(self, _key):
        return self.process

    def give_back(self, _key, _process):
        pass


@pytest.mark.parametrize("do", ["start", "step"])
def test_answers_of_calvin(monkeypatch, do):
    folder = str(Path(__file__).parent)
    code = f"import sys; sys.path.append({folder!r})\n{start_code('fake_calvin')}"
    command = (sys.executable, "-c", code, folder, "", "")
    plan = make_world_plan("noop", suite="calvin", command=command, trials=1, broken_premises="run")
    processes = _Same(command)
    with processes.process:
        scene = plan.world.open_scene(
            processes, task="calvin", condition="base", seed=0, action_space=CALVIN_RELATIVE, images=False
        )
        scene.reset()
        answer = scene._document, scene._arrays
        follow(scene, begin=False)
        if do == "step":
            answer = scene._document, scene._arrays
        count = 0
        for other in drawn(answer, 4):
            with answering(monkeypatch, do, other):
                count += refused(lambda: follow(scene, begin=do == "start"))
    assert count > 10


@pytest.mark.parametrize("suite", ["libero_object", "libero_object_swap"])
def test_descriptions_of_libero(fake_command, monkeypatch, suite):
    answer = genuine(fake_command, ({"do": "suite", "suite": suite}, {}))

    class Described:
        """A process that was started already."""

        def __init__(self, _command):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def suite(self, _name):
            return said[0]

    monkeypatch.setattr("betterbench.sim.worlds.libero.world.WorldProcess", Described)
    count = 0
    said = [answer[0]]
    for said[0], _ in drawn(answer, 2):
        count += refused(lambda: make_world_plan("noop", suite=suite, command=fake_command, tasks=["3"], trials=1))
    assert count > 10


def test_premises_of_libero(fake_command, monkeypatch):
    request = {"do": "premises", "suite": "libero_object", "task": 0}
    count = 0
    with WorldProcess(fake_command) as process:
        suite = process._ask({"do": "suite", "suite": "libero_object"}, {}, 60.0)
        premises = process._ask(request, {}, 60.0)
        for do, answer in (("premises", premises), ("suite", suite)):
            for other in drawn(answer, 3):
                with answering(monkeypatch, do, other):
                    count += refused(lambda: next(check_premises(process, "libero_object")))
    assert count > 20
