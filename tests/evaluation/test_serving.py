"""What is served: experts that shadow, policies that see, and clients that say less than ours do."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
import threading
import time
from typing import ClassVar

import numpy as np
import pytest
from tests.looping import each
from websockets.sync.client import connect

from betterbench.episodes import Observer
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation import open_server
from betterbench.evaluation.serving.shadow import ShadowSimulation
from betterbench.interface import EpisodeStart, Execution, Observation, PolicyInfo, episode_number, observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies import Random
from betterbench.policies.conventions.presets import NATIVE, OPENPI_LIBERO
from betterbench.policies.conventions.request import read_request
from betterbench.policies.experts import make_expert
from betterbench.policies.kinds import make_policy
from betterbench.policies.protocols.wire import decode_openpi, encode_openpi
from betterbench.sim.scenes import Scene, engine_version
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId, all_tasks
from betterbench.tasks.interventions import resolve_condition

TRIAL = TrialId("morning_coffee", "train1", 0)
PATIENCE_S = 60


class Client:
    """A client in raw frames that plays one of our scenes."""

    def __init__(self, server, trial=TRIAL, *, images=False):
        self.link = connect(f"ws://127.0.0.1:{server.port}", compression=None, max_size=None)
        self.trial = trial
        found = resolve_condition(trial.task, trial.condition)
        task, condition = found.task, found.condition
        self.scene = Scene(task, condition, seed=trial.seed, action_space=EE_DELTA, quality=quality_preset("fast"))
        self.observer = Observer(observation_spec("default" if images else "state_only"))
        self.state = self.scene.reset()
        self.start = EpisodeStart(condition.instruction.text, episode_number(trial.seed), "ee_delta")

    def __enter__(self):
        self.link = self.link.__enter__()
        self.metadata = decode_openpi(self.link.recv(timeout=PATIENCE_S))
        return self

    def __exit__(self, *problem):
        self.observer.close()
        self.link.__exit__(*problem)

    @property
    def seen(self):
        return self.observer.observe(self.scene, self.state)

    def ask(self, message):
        self.link.send(encode_openpi(message))
        answer = self.link.recv(timeout=PATIENCE_S)
        return answer if isinstance(answer, str) else decode_openpi(answer)["actions"]

    def native(self, **changes):
        return self.ask({**NATIVE.request(self.seen, self.start, self.trial), **changes})

    def libero(self, **changes):
        return self.ask({**LIBERO_STATE.request(self.seen), **changes})

    def execute(self, actions):
        for action in actions:
            self.scene.step(action)
            self.state = self.scene.state()


LIBERO_STATE = dataclasses.replace(OPENPI_LIBERO, views=())


@pytest.fixture(scope="module")
def expert_server():
    with open_server("expert", port=0, chunk=8) as server:
        yield server


@pytest.fixture(scope="module")
def known():
    """The first actions of the expert on two trials."""
    return {
        trial: ShadowSimulation("expert", trial).actions(0, 64)
        for trial in (TRIAL, TrialId("morning_coffee", "train2", 0))
    }


def test_the_greeting_declares_every_convention(expert_server):
    with Client(expert_server) as client:
        told = client.metadata["betterbench"]
        assert told["engine"] == f"mujoco {engine_version()}"  # of the installed distribution and of its module
    assert told["protocol"] == 1
    assert (told["preset"], told["policy"], told["chunk"]) == ("native", "expert", 8)
    assert told["action_space"] == EE_DELTA.to_json()
    assert told["needs_images"] is False
    assert told["control_rate_hz"] == 20.0


def test_a_client_that_executes_part_of_each_chunk_gets_the_experts_actions(expert_server, known):
    played = []
    with Client(expert_server) as client:
        while len(played) < 40:
            actions = client.native()
            assert actions.shape == (8, 7)
            client.execute(actions[:5])
            played.extend(actions[:5])
    np.testing.assert_array_equal(np.array(played), known[TRIAL][: len(played)])


def test_a_client_that_comes_back_in_the_middle_goes_on(expert_server, known):
    with Client(expert_server) as client:
        client.execute(client.native())
        with Client(expert_server) as other:
            other.scene, other.state = client.scene, client.state
            np.testing.assert_array_equal(other.native(), known[TRIAL][8:16])


def test_two_clients_at_once_play_their_own_trials(expert_server, known):
    played = {trial: [] for trial in known}

    def play(trial):
        with Client(expert_server, trial) as client:
            while len(played[trial]) < 32:
                actions = client.native()
                client.execute(actions)
                played[trial].extend(actions)

    threads = [threading.Thread(target=play, args=(trial,)) for trial in played]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    for trial, actions in played.items():
        np.testing.assert_array_equal(np.array(actions), known[trial][:32])


@each(
    "changes, text",
    [
        ({"better/step": 5}, "executed other actions"),
        ({"better/step": 100_000}, "ends after"),
        ({"better/step": -1}, "better/step"),
        (
            {"better/joint_positions": np.zeros(6)},
            "better/joint_velocities: expected 6 numbers, one per joint position, got 7",
        ),
        ({"better/ee_position": np.full(3, np.nan)}, "better/ee_position"),
        ({"better/images/front": np.zeros((4, 4, 3))}, "better/images/front: got float64"),
        ({"better/episode": "fast_food"}, "better/episode"),
        ({"better/episode": {"task": "fast_food", "condition": "T1", "seed": 0}}, "action_space"),
        ({"better/episode": {"task": "no", "condition": "T1", "seed": 0, "action_space": "ee_delta"}}, "Unknown task"),
        (
            {"better/episode": {"task": "fast_food", "condition": "T99", "seed": 0, "action_space": "ee_delta"}},
            "Unknown condition of fast_food 'T99'",
        ),
        (
            {"better/episode": {"task": "fast_food", "condition": "T1", "seed": 0, "action_space": "ee_pose"}},
            "the client executes 'ee_pose'",
        ),
        ({"prompt": "Sing."}, "Client and server have different versions"),
        ({"prompt": 7}, "prompt"),
    ],
)
def test_what_is_wrong_with_a_question_is_said_in_one_line(expert_server, changes, text):
    with Client(expert_server) as client:
        answer = client.native(**changes)
    assert isinstance(answer, str)
    assert text in answer
    assert "\n" not in answer


# ------------------------------------------------------------------------------------- clients that name no trial


def instructions():
    said = [c.instruction.text for t in all_tasks() for c in t.training]
    return {text: next(c for t in all_tasks() for c in t.training if c.instruction.text == text) for text in said}


def test_a_prompt_is_looked_up_among_the_training_conditions(expert_server):
    text, condition = next(iter(instructions().items()))
    trial = TrialId(condition.task, condition.name, 0)
    message = {"prompt": text, "observation/state": np.zeros(8, np.float32)}
    message["observation/image"] = message["observation/wrist_image"] = np.zeros((224, 224, 3), np.uint8)
    with Client(expert_server) as client:
        first, second, again = client.ask(message), client.ask(message), client.ask({**message, "better/step": 0})
    expected = ShadowSimulation("expert", trial).actions(0, 16)
    np.testing.assert_array_equal(np.concatenate([first, second]), expected)
    np.testing.assert_array_equal(again, expected[:8])


def test_a_changed_prompt_is_a_new_episode(expert_server):
    one, two = list(instructions())[:2]
    with Client(expert_server) as client:
        first = client.ask({"prompt": one})
        client.ask({"prompt": two})
        np.testing.assert_array_equal(client.ask({"prompt": one}), first)


def test_a_prompt_that_matches_nothing_is_answered_with_the_closest(expert_server):
    with Client(expert_server) as client:
        answer = client.ask({"prompt": "put the red mug on the ring of the coffee maker"})
    assert "no training condition has the instruction" in answer
    assert "its handle not facing the machine.' (morning_coffee/train1)" in answer
    assert "--task" in answer


def test_the_trial_of_the_command_line_goes_before_the_prompt(known):
    with open_server("expert", port=0, chunk=4, trial=TRIAL) as server, Client(server) as client:
        np.testing.assert_array_equal(client.ask({"prompt": "do something"}), known[TRIAL][:4])
        assert client.metadata["betterbench"]["trial"] == "morning_coffee/train1/0"


@pytest.mark.parametrize("executed", [8, 5, 3])
def test_the_state_of_a_client_that_does_not_count_shows_how_much_it_has_executed(executed, known):
    played = []
    with open_server("expert", port=0, chunk=8, trial=TRIAL) as server, Client(server) as client:
        while len(played) < 30:
            actions = client.libero()
            client.execute(actions[:executed])
            played.extend(actions[:executed])
    np.testing.assert_array_equal(np.array(played), known[TRIAL][: len(played)])


@pytest.mark.parametrize(
    ("number", "value"),
    [pytest.param(2, 1.0, id="goes up"), pytest.param(5, 0.5, id="turns"), pytest.param(6, 1.0, id="closes")],
)
@pytest.mark.parametrize("counts", [False, True])
def test_a_client_with_liberos_layout_that_plays_other_actions_is_told(number, value, counts):
    with open_server("expert", port=0, chunk=8, trial=TRIAL) as server, Client(server) as client:
        actions = client.libero(**({"better/step": 0} if counts else {}))
        actions = actions.copy()
        actions[:, number] = value
        client.execute(actions)
        answer = client.libero(**({"better/step": 8} if counts else {}))
    assert isinstance(answer, str)
    assert "morning_coffee/train1/0 step 8: the client's robot is not in the simulated state" in answer
    assert "executed other actions" in answer
    assert "\n" not in answer


def test_a_client_that_does_not_count_may_ask_again(known):
    with open_server("expert", port=0, chunk=8, trial=TRIAL) as server, Client(server) as client:
        for begin in (0, 0, 8, 8, 8, 16):
            if begin > client.state.step:
                client.execute(known[TRIAL][client.state.step : begin])
            np.testing.assert_array_equal(client.libero(), known[TRIAL][begin : begin + 8])


def test_another_origin_and_no_state_at_all_are_no_other_actions(known):
    moved = dataclasses.replace(LIBERO_STATE, ee_offset_m=(-0.66, 0.0, 0.912))
    with open_server("expert", port=0, chunk=8, trial=TRIAL) as server:
        for message in (moved.request, lambda seen: {"prompt": seen.instruction, "observation/state": np.zeros(8)}):
            played = []
            with Client(server) as client:
                while len(played) < 32:
                    actions = client.ask(message(client.seen))
                    client.execute(actions)
                    played.extend(actions)
            np.testing.assert_array_equal(np.array(played), known[TRIAL][:32])


# --------------------------------------------------------------------------------------------- policies that see


def test_the_random_walk_of_a_trial_is_the_same_behind_the_server():
    with open_server("random", port=0) as server, Client(server) as client:
        local = Random()
        local.reset(client.start)
        for _ in range(5):
            expected = local.act(client.seen)
            actions = client.native()
            assert actions.shape == (1, 7)
            np.testing.assert_array_equal(actions[0], expected)
            client.execute(actions)


def test_an_episode_begins_with_step_0_on_the_same_connection():
    with open_server("random", port=0) as server, Client(server) as client:
        first = client.native()
        second = client.native(**{"better/step": 1})
        again = client.native()
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(again, first)


class Looking:
    """Says what it was shown, and how many were asked together."""

    info = PolicyInfo("looking", metadata={"revision": "7"})
    made: ClassVar[int] = 0
    batches: ClassVar[list[int]] = []
    begun: ClassVar[threading.Event] = threading.Event()
    go_on: ClassVar[threading.Event] = threading.Event()

    def __init__(self):
        type(self).made += 1

    def reset(self, start):
        self.start = start

    def act(self, observation: Observation):
        return self.act_batch([observation])[0]

    def act_batch(self, observations):
        self.batches.append(len(observations))
        self.begun.set()
        assert self.go_on.wait(PATIENCE_S)
        return [np.array([[o.step, float(o.images["front"].mean()), *np.zeros(5)]] * 3) for o in observations]


@pytest.fixture
def looking(monkeypatch):
    Looking.made, Looking.batches = 0, []
    Looking.begun, Looking.go_on = threading.Event(), threading.Event()
    monkeypatch.setitem(sys.modules, "looking_policy", type(sys)("looking_policy"))
    sys.modules["looking_policy"].Looking = Looking
    return "python:looking_policy:Looking"


def image(value):
    return np.full((8, 8, 3), value, np.uint8)


def test_what_waits_at_one_moment_is_one_batch_for_a_policy_that_takes_batches(looking):
    answers = {}
    with open_server(looking, port=0, batch=2) as server:

        def work(number):
            with Client(server) as client:
                answers[number] = client.native(**{"better/images/front": image(number)})

        threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
        threads[0].start()
        assert Looking.begun.wait(PATIENCE_S)
        for thread in threads[1:]:
            thread.start()
        collector = next(t for t in threading.enumerate() if t.name == "collector")
        waiting = collector._target.__self__._waiting
        for _ in range(2000):
            if waiting.qsize() == 3:
                break
            threading.Event().wait(0.005)
        Looking.go_on.set()
        for thread in threads:
            thread.join(PATIENCE_S)
    assert Looking.made == 1
    assert Looking.batches == [1, 2, 1]
    assert {n: a[0, 1] for n, a in answers.items()} == {n: float(n) for n in range(4)}


def test_a_client_with_liberos_layout_is_shown_to_a_policy_as_an_observation(looking):
    Looking.go_on.set()
    with open_server(looking, port=0) as server, Client(server) as client:
        message = {"observation/image": image(9), "observation/wrist_image": image(3)}
        first, second = client.libero(**message), client.libero(**message)
    assert first[0, :2].tolist() == [0.0, 9.0]
    assert second[0, :2].tolist() == [3.0, 9.0]
    assert client.metadata["betterbench"]["revision"] == "7"
    assert client.metadata["betterbench"]["needs_images"] is True


def test_liberos_layout_is_read_as_it_is_written():
    server_side = Observation(
        instruction="Go.",
        step=0,
        images={},
        joint_positions=np.zeros(7),
        joint_velocities=np.zeros(7),
        ee_position=np.array([0.4, -0.1, 0.2]),
        ee_quaternion=np.array([0.1, 0.9, 0.3, 0.2]) / np.linalg.norm([0.1, 0.9, 0.3, 0.2]),
        gripper_width=0.05,
        depth={},
        masks={},
    )
    request = read_request(decode_openpi(encode_openpi(LIBERO_STATE.request(server_side))))
    seen = request.observation
    assert seen is not None
    np.testing.assert_allclose(seen.ee_position, server_side.ee_position, atol=1e-6)
    np.testing.assert_allclose(seen.ee_quaternion, server_side.ee_quaternion, atol=1e-6)
    assert seen.gripper_width == pytest.approx(0.05, abs=1e-6)
    assert np.isnan(seen.joint_positions).all()
    assert not request.measured


def test_a_policy_without_batches_gets_an_instance_for_each_client(monkeypatch):
    made = []

    class Plain(Random):
        def __init__(self):
            super().__init__()
            made.append(self)

    monkeypatch.setitem(sys.modules, "plain_policy", type(sys)("plain_policy"))
    sys.modules["plain_policy"].Plain = Plain
    with open_server("python:plain_policy:Plain", port=0) as server, Client(server) as one, Client(server) as two:
        np.testing.assert_array_equal(one.native(), two.native())
        one.native()
    assert len(made) == 2


def test_an_instance_serves_the_next_client_when_its_own_has_left_or_failed(monkeypatch):
    made, closed = [], []

    class Plain(Random):
        def __init__(self):
            super().__init__()
            made.append(self)

        def act(self, observation):
            if observation.instruction == "Fail.":
                raise RuntimeError("asked to")
            return super().act(observation)

        def close(self):
            closed.append(self)

    monkeypatch.setitem(sys.modules, "plain_policy", type(sys)("plain_policy"))
    sys.modules["plain_policy"].Plain = Plain
    with open_server("python:plain_policy:Plain", port=0) as server:
        answers = []
        for _ in range(4):
            with Client(server) as client:
                answers.append(client.native())
                assert "asked to" in client.native(prompt="Fail.")
        assert len(made) == 1
        assert closed == []
        for again in answers[1:]:
            np.testing.assert_array_equal(again, answers[0])  # it began anew
    assert closed == made


def test_instances_that_nobody_needs_any_more_are_given_back(monkeypatch):
    made, closed = [], []

    class Plain(Random):
        def __init__(self):
            super().__init__()
            made.append(self)

        def close(self):
            closed.append(self)

    monkeypatch.setitem(sys.modules, "plain_policy", type(sys)("plain_policy"))
    sys.modules["plain_policy"].Plain = Plain
    with open_server("python:plain_policy:Plain", port=0) as server:
        before = threading.active_count()
        with contextlib.ExitStack() as stack:
            clients = [stack.enter_context(Client(server)) for _ in range(5)]
            assert len(made) == 1, "the first one was made to ask it what it is; an idle client has none"
            for one in clients:
                one.native()
            assert len(made) == 5
        for _ in range(1000):
            if len(closed) == 4 and threading.active_count() == before:
                break
            time.sleep(0.01)
        assert len(closed) == 4
        assert threading.active_count() == before, "the threads of their collectors have ended"


@pytest.mark.parametrize("execution", [Execution(horizon=2), Execution(horizon=6, ahead=2), Execution(ensemble=0.1)])
def test_a_served_policy_says_how_its_chunks_are_played(monkeypatch, execution):
    class Chunky(Random):
        info = PolicyInfo("chunky", execution=execution)

    monkeypatch.setitem(sys.modules, "chunky_policy", type(sys)("chunky_policy"))
    sys.modules["chunky_policy"].Chunky = Chunky
    with open_server("python:chunky_policy:Chunky", port=0) as server:
        with contextlib.closing(make_policy(f"openpi://127.0.0.1:{server.port}")) as served:
            assert served.info.execution == execution
        with contextlib.closing(make_policy(f"openpi://127.0.0.1:{server.port}?horizon=3")) as changed:
            assert changed.info.execution == Execution(horizon=3), "what the address says goes first"


def test_a_policy_without_an_observation_says_what_it_misses():
    with open_server("noop", port=0) as server, Client(server) as client:
        assert "contains no observation" in client.ask({"prompt": "Go."})


@pytest.mark.parametrize(
    ("policy", "options", "error", "text"),
    [
        ("replay:somewhere", {}, InvalidInputError, "Evaluate it with better eval"),
        ("exprt", {}, UnknownNameError, "expert"),
        ("zoo:lexical?strenght=1", {}, UnknownNameError, "strength"),
        ("expert", {"chunk": 0}, InvalidInputError, "--chunk"),
        ("expert", {"batch": 0}, InvalidInputError, "--batch"),
        ("expert", {"trial": TrialId("fast_food", "T77", 0)}, UnknownNameError, "T1"),
    ],
)
def test_what_cannot_be_served_is_one_clear_line(policy, options, error, text):
    with pytest.raises(error, match=text):
        open_server(policy, port=0, **options)


def test_the_served_expert_is_the_expert():
    """The shadow's policy is the one that is evaluated, not another one of the same name."""
    found = resolve_condition(TRIAL.task, TRIAL.condition)
    task, condition = found.task, found.condition
    scene = Scene(task, condition, seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    action = make_expert("expert", scene).act_on_state(scene.reset())
    np.testing.assert_array_equal(ShadowSimulation("expert", TRIAL).actions(0, 1)[0], action)
