"""Preflight check of a policy: the handshake, one observation, and the policy's first replies."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from betterbench.episodes import POLICY_BOUNDARY, Observer
from betterbench.episodes.chunks import checked_chunk
from betterbench.errors import InvalidInputError
from betterbench.evaluation.preflight.proof import ReplayProof, prove_by_replay
from betterbench.evaluation.trials.policy_thread import name_trial
from betterbench.interface import (
    EpisodeStart,
    Observation,
    ObservationSpec,
    Policy,
    PolicyInfo,
    episode_number,
    observation_spec,
)
from betterbench.interface.actions import USUAL_ROBOT, ActionSpace, action_space
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.handshake import Declaration, declare_adapter, declare_space
from betterbench.policies.conventions.image_rule import EVERY_CAMERA, ImageRule
from betterbench.policies.factory import PolicyFactory, check_action_space, close_policy
from betterbench.policies.kinds import kind_of, make_policy, make_privileged, needs_of
from betterbench.sim.robots import robot_space
from betterbench.sim.scenes import CONTROL_RATE_HZ, Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

REQUESTS = 5
"""Number of requests whose latency is measured, after the first request."""


@dataclass(frozen=True, slots=True)
class Convention:
    """Value of one convention, as declared by betterbench (``ours``) and by the policy (``theirs``).

    An empty string means that the side does not declare this convention.
    """

    name: str
    ours: str
    theirs: str

    @property
    def differs(self) -> bool:
        """Whether betterbench and the policy both declare a value, and these values differ."""
        return bool(self.ours and self.theirs) and self.ours != self.theirs


@dataclass(frozen=True, slots=True, eq=False)
class ShownImage:
    """Image that the policy receives, (height, width, 3) uint8, with its key and a description of the conversion."""

    key: str
    image: np.ndarray
    note: str


@dataclass(frozen=True, slots=True, eq=False)
class PreflightCheck:
    """Result of a preflight check.

    Attributes:
        policy: Address of the policy.
        trial: Trial whose first observation was sent to the policy.
        quality: Name of the rendering preset.
        info: Description of the policy.
        conventions: Conventions, as betterbench and the policy declare them.
        adapter: Adapter that converts observations for the policy, or None if they are sent unchanged.
        shown: Images as they are sent to the policy.
        state: State inputs of the policy, by key.
        prompt: Instruction as it is sent to the policy.
        actions: Actions in the first reply, (horizon, dim), in the action space that ``info`` names.
        first_s: Latency of the first request [s].
        latencies_s: Latencies of the later requests [s].
        proof: Comparison of the policy with a demonstration, or None if there was no comparison.
        robot: Name of the robot.
    """

    policy: str
    trial: TrialId
    quality: str
    info: PolicyInfo
    conventions: tuple[Convention, ...]
    adapter: Adapter | None
    shown: tuple[ShownImage, ...]
    state: tuple[tuple[str, np.ndarray], ...]
    prompt: str
    actions: np.ndarray
    first_s: float
    latencies_s: tuple[float, ...]
    proof: ReplayProof | None = None
    robot: str = USUAL_ROBOT

    @property
    def p50_s(self) -> float:
        """Median latency of the requests after the first one [s]."""
        return float(np.median(self.latencies_s))

    @property
    def max_s(self) -> float:
        """Largest latency of the requests after the first one [s]."""
        return max(self.latencies_s)

    @property
    def clipped(self) -> int:
        """Number of actions in the first reply that would be clipped in a run."""
        return action_space(self.info.action_space).count_clipped(self.actions)

    def to_json(self) -> dict[str, Any]:
        """Return the result as a JSON-serializable dict. Images are replaced by their sizes."""
        return {
            "policy": self.policy,
            "trial": asdict(self.trial),
            "robot": self.robot,
            "action_space": self.info.action_space,
            "needs_images": self.info.needs_images,
            "metadata": dict(self.info.metadata),
            "conventions": [{**asdict(c), "differs": c.differs} for c in self.conventions],
            "adapter": None if self.adapter is None else self.adapter.to_json(),
            "prompt": self.prompt,
            "images": [
                {"key": s.key, "width": s.image.shape[1], "height": s.image.shape[0], "note": s.note}
                for s in self.shown
            ],
            "state": {key: values.tolist() for key, values in self.state},
            "actions": self.actions.tolist(),
            "clipped_actions": self.clipped,
            "latency_s": {
                "first": self.first_s,
                "p50": self.p50_s,
                "max": self.max_s,
                "requests": len(self.latencies_s),
            },
            "proof": None if self.proof is None else self.proof.to_json(),
        }


def run_preflight(
    policy: str,
    trial: TrialId,
    *,
    action_space_name: str | None = None,
    observation: str = "default",
    quality: str = "standard",
    proof: bool = False,
    robot: str = USUAL_ROBOT,
    on_conventions: Callable[[tuple[Convention, ...]], None] | None = None,
) -> PreflightCheck:
    """Check a policy by sending it the first requests of a trial, with the settings of a planned run.

    The default action space is the robot's standard action space if the policy supports it, or else the policy's own
    action space. If ``proof`` is True and the policy uses observations, it also gets the observations of a
    demonstration (:mod:`betterbench.evaluation.preflight.proof`). ``on_conventions`` is called with the conventions of
    both sides before they are compared.

    Raises:
        BetterError: If the policy does not answer, if its conventions differ from those of the run, or if its actions
            are invalid.
    """
    needs = needs_of(policy)
    if needs.trial:
        raise InvalidInputError(
            f"policy {policy}",
            "a replay policy only repeats recorded actions",
            "Inspect the run that it replays with better report",
        )
    found = resolve_condition(trial.task, trial.condition)
    with PolicyFactory(policy) as policies:
        info = policies.check()
        client = None if needs.state else policies.take()
    try:
        usual = robot_space(robot, action_space_name)
        space = action_space(action_space_name or (usual if usual in kind_of(policy).spaces else info.action_space))
        robot_space(robot, space.name)
        spec = observation_spec(observation)
        conventions = policy_conventions(client, policy, info, space)
        if on_conventions is not None:
            on_conventions(conventions)
        info = check_action_space(policy, info, space.name)
        agree = getattr(client, "check", None)
        if callable(agree):
            agree(space=space.name, observation=spec, rate_hz=CONTROL_RATE_HZ)
        if info.needs_images:
            spec = spec.only(info.cameras)
        scene = Scene(
            found.task,
            found.condition,
            seed=trial.seed,
            action_space=space,
            quality=quality_preset(quality),
            robot_name=robot,
        )
        seen, ask = _first_question(policy, client, scene, trial, spec if info.needs_images else None)
        actions, first_s, latencies_s = _ask_often(ask, space, ahead=info.execution.ahead)
        adapter = _adapter_of(client)
        proven = None
        if proof and client is not None:
            if needs.server:  # a new connection begins a new episode
                close_policy(client)
                client = make_policy(policy)
                name_trial(client, trial)
            shown = spec if info.needs_images else observation_spec("state_only")
            proven = prove_by_replay(
                client, info, trial, space=space, spec=shown, quality=quality_preset(quality), robot=robot
            )
        return PreflightCheck(
            policy=policy,
            trial=trial,
            quality=quality,
            info=info,
            conventions=conventions,
            adapter=adapter,
            shown=() if seen is None else _shown(seen, adapter),
            state=() if seen is None else _state(seen, adapter),
            prompt=found.condition.instruction.text,
            actions=actions,
            first_s=first_s,
            latencies_s=latencies_s,
            proof=proven,
            robot=robot,
        )
    finally:
        close_policy(client)


def _first_question(
    policy: str, client: Policy | None, scene: Scene, trial: TrialId, images: ObservationSpec | None
) -> tuple[Observation | None, Callable[[], np.ndarray]]:
    """Begin the episode. Return its first observation and a function that requests actions.

    The observation is None for a privileged policy.
    """
    state = scene.reset()
    if client is None:
        privileged = make_privileged(policy, scene)
        return None, lambda: privileged.act_on_state(state)
    observer = Observer(images or observation_spec("state_only"))
    try:
        seen = observer.observe(scene, state)
    finally:
        observer.close()
    if needs_of(policy).server:
        name_trial(client, trial)
    with POLICY_BOUNDARY:
        client.reset(EpisodeStart(seen.instruction, episode_number(trial.seed), scene.action_space.name))
    return seen, lambda: client.act(seen)


def _ask_often(
    ask: Callable[[], np.ndarray], space: ActionSpace, *, ahead: int
) -> tuple[np.ndarray, float, tuple[float, ...]]:
    """Send the same request several times.

    Return the first reply (horizon, dim), its latency [s], and the latencies of the later replies [s].
    """
    answers, times = [], []
    for _ in range(1 + REQUESTS):
        began = time.perf_counter()
        with POLICY_BOUNDARY:
            answers.append(np.asarray(ask()))
        times.append(time.perf_counter() - began)
    chunks = [checked_chunk(answer, space) for answer in answers]
    for chunk in chunks:
        for action in chunk:
            space.clip(action)
        if ahead >= len(chunk):
            raise InvalidInputError(
                "ahead",
                f"ahead={ahead} is too large, because a chunk has {len(chunk)} actions",
                "Use a smaller value of ahead",
            )
    return chunks[0], times[0], tuple(times[1:])


def policy_conventions(
    client: Policy | None, policy: str, info: PolicyInfo, space: ActionSpace
) -> tuple[Convention, ...]:
    """Return the conventions of betterbench and of the policy. ``client`` is None for a privileged policy."""
    adapter, server = _adapter_of(client), getattr(client, "server", None)
    if adapter is not None and isinstance(server, Declaration):
        ours = replace(declare_adapter("this side", adapter, rate_hz=CONTROL_RATE_HZ), action_space=space.name)
        offered = getattr(client, "offered", None)
        if isinstance(offered, Declaration):
            words = {f.name: getattr(offered, f.name) for f in fields(offered) if f.name != "who"}
            ours = replace(ours, **{name: word for name, word in words.items() if word is not None})
        theirs = server
    else:
        ours, theirs = declare_space("this side", space), declare_space(policy, action_space(info.action_space))
    left, right = ours.rows(), theirs.rows()
    return tuple(Convention(n, left.get(n, ""), right.get(n, "")) for n in dict.fromkeys((*left, *right)))


def _adapter_of(client: Policy | None) -> Adapter | None:
    adapter = getattr(client, "adapter", None)
    return adapter if isinstance(adapter, Adapter) else None


def _shown(seen: Observation, adapter: Adapter | None) -> tuple[ShownImage, ...]:
    """Return the images in the form in which they are sent to the policy."""
    if adapter is None:
        return tuple(ShownImage(name, np.asarray(p), _note(name, p, None)) for name, p in seen.images.items())
    rules = {
        rule.named(camera): (camera, rule)
        for rule in adapter.views
        for camera in (seen.images if rule.camera == EVERY_CAMERA else (rule.camera,))
    }
    return tuple(
        ShownImage("/".join(key), image, _note(rules[key][0], seen.images[rules[key][0]], rules[key][1]))
        for key, image in adapter.images(seen).items()
    )


def _note(camera: str, rendered: np.ndarray, rule: ImageRule | None) -> str:
    """Describe the camera and the conversion of an image."""
    height, width = rendered.shape[:2]
    parts = [f"camera {camera}", f"rendered {width} x {height}"]
    if rule is None:
        return ", ".join([*parts, "unchanged"])
    if rule.turn:
        parts.append(f"rotated by {rule.turn} degrees")
    if rule.mirror:
        parts.append("mirrored")
    if rule.keep < 1.0:
        parts.append(f"center crop of {rule.keep:.0%}")
    if rule.width is None or (rule.width, rule.height) == (width, height):
        parts.append("size kept")
    else:
        parts.append(f"shown {rule.width} x {rule.height} ({rule.fit})")
    return ", ".join(parts)


def _state(seen: Observation, adapter: Adapter | None) -> tuple[tuple[str, np.ndarray], ...]:
    """Return the state inputs of the policy, by key."""
    if adapter is None:
        return (
            ("joint_positions", seen.joint_positions),
            ("joint_velocities", seen.joint_velocities),
            ("ee_position", seen.ee_position),
            ("ee_quaternion", seen.ee_quaternion),
            ("gripper_width", np.array([float(seen.gripper_width)])),
        )
    rows = []
    for rule in adapter.states:
        for part in rule.parts:
            one = replace(rule, parts=(part,), scalar=False)
            values = adapter.state(one, seen)
            key = "/".join(rule.key)
            rows.append((key if len(rule.parts) == 1 else f"{key}: {part}", np.atleast_1d(values)))
    return tuple(rows)
