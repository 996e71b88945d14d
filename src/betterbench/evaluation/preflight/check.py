"""A consultation: the handshake with a policy, one observation, one answer, and what both look like."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from betterbench.episodes import POLICY_BOUNDARY, Observer
from betterbench.episodes.chunks import checked_chunk
from betterbench.errors import InvalidInputError
from betterbench.evaluation.preflight.sheet import Shown
from betterbench.evaluation.serving.shadow import TrialName
from betterbench.evaluation.trials.policy_factory import PolicyFactory, check_action_space, close_policy, is_privileged
from betterbench.experts import make_expert
from betterbench.interface import EpisodeStart, Observation, Policy, PolicyInfo, observation_spec
from betterbench.interface.actions import ActionSpace, action_space
from betterbench.policies.adapter import Adapter
from betterbench.policies.handshake import Declaration, declare_adapter, declare_space
from betterbench.policies.image_rule import EVERY_CAMERA, ImageRule
from betterbench.scenes import CONTROL_RATE_HZ, Scene
from betterbench.scenes.stage import quality_preset

REQUESTS = 5
"""Requests whose time is measured, after the first one."""


@dataclass(frozen=True, slots=True)
class Convention:
    """One convention, as both sides declare it.

    Attributes:
        name: What it is about.
        ours: What this side says, empty if nothing.
        theirs: What the policy's side says, empty if nothing.
    """

    name: str
    ours: str
    theirs: str

    @property
    def differs(self) -> bool:
        """Whether both sides say something, and not the same."""
        return bool(self.ours and self.theirs) and self.ours != self.theirs


@dataclass(frozen=True, slots=True, eq=False)
class PreflightCheck:
    """What came of it.

    Attributes:
        policy: Address of the policy.
        trial: The trial whose start the policy was shown.
        quality: Name of the render preset.
        info: What the policy says about itself.
        conventions: What both sides declare.
        adapter: How the policy is spoken to, or None for one that gets our observation as it is.
        shown: The images as the policy gets them.
        state: The numbers it gets, by key.
        prompt: The sentence it gets.
        actions: (horizon, dim) its first answer, in the action space of ``info``.
        first_s: Time of the first request [s].
        latencies_s: Times of the requests after it [s].
    """

    policy: str
    trial: TrialName
    quality: str
    info: PolicyInfo
    conventions: tuple[Convention, ...]
    adapter: Adapter | None
    shown: tuple[Shown, ...]
    state: tuple[tuple[str, np.ndarray], ...]
    prompt: str
    actions: np.ndarray
    first_s: float
    latencies_s: tuple[float, ...]

    @property
    def p50_s(self) -> float:
        """Median time of a request [s]."""
        return float(np.median(self.latencies_s))

    @property
    def max_s(self) -> float:
        """Longest time of a request after the first one [s]."""
        return max(self.latencies_s)

    @property
    def clipped(self) -> int:
        """How many actions of the first answer a run would clip, because a number is out of range."""
        space = action_space(self.info.action_space)
        return sum(space.clip(action).tolist() != action.tolist() for action in self.actions)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form, images as their sizes."""
        return {
            "policy": self.policy,
            "trial": {"task": self.trial.task, "condition": self.trial.condition, "seed": self.trial.seed},
            "action_space": self.info.action_space,
            "needs_images": self.info.needs_images,
            "metadata": dict(self.info.metadata),
            "conventions": [
                {"name": c.name, "ours": c.ours, "theirs": c.theirs, "differs": c.differs} for c in self.conventions
            ],
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
        }


def run_preflight(
    policy: str,
    trial: TrialName,
    *,
    action_space_name: str | None = None,
    observation: str = "default",
    quality: str = "standard",
    on_conventions: Callable[[tuple[Convention, ...]], None] | None = None,
) -> PreflightCheck:
    """Ask a policy what it would do at the start of a trial.

    Args:
        policy: Address of the policy.
        trial: The trial.
        action_space_name: Action space of the run to come; the policy's own if not given.
        observation: Observation preset of the run.
        quality: Render preset of the run.
        on_conventions: Told what both sides declare, before they are compared.

    Returns:
        What came of it.

    Raises:
        BetterError: If the policy cannot be asked, declares other conventions than the run, or answers nonsense.
    """
    if policy.startswith("replay:"):
        raise InvalidInputError(f"policy {policy}", "a replay asks for nothing", "Look at its run with better report")
    task, condition = trial.resolve()
    with PolicyFactory(policy) as policies:
        info = policies.check()
        client = None if is_privileged(policy) else policies.take()
    try:
        space = action_space(action_space_name or info.action_space)
        spec = observation_spec(observation)
        if on_conventions is not None:
            on_conventions(policy_conventions(client, policy, info, space))
        check_action_space(policy, info, space.name)
        agree = getattr(client, "check", None)
        if callable(agree):
            agree(space=space.name, observation=spec, rate_hz=CONTROL_RATE_HZ)
        scene = Scene(task, condition, seed=trial.seed, action_space=space, quality=quality_preset(quality))
        state = scene.reset()
        seen: Observation | None = None
        if client is None:
            expert = make_expert(policy, scene)
            answers = _Answers(lambda: expert.act_on_state(state), space)
        else:
            observer = Observer(spec if info.needs_images else observation_spec("state_only"))
            try:
                seen = shown = observer.observe(scene, state)
            finally:
                observer.close()
            text = condition.instruction.text
            with POLICY_BOUNDARY:
                client.reset(EpisodeStart(text, trial.seed, space.name, task=trial.task, condition=trial.condition))
            answers = _Answers(lambda: client.act(shown), space, ahead=info.execution.ahead)
        actions, first_s, latencies_s = answers.ask()
        adapter = _adapter_of(client)
        return PreflightCheck(
            policy=policy,
            trial=trial,
            quality=quality,
            info=info,
            conventions=policy_conventions(client, policy, info, space),
            adapter=adapter,
            shown=() if seen is None else _shown(seen, adapter),
            state=() if seen is None else _state(seen, adapter),
            prompt=condition.instruction.text,
            actions=actions,
            first_s=first_s,
            latencies_s=latencies_s,
        )
    finally:
        close_policy(client)


def policy_conventions(
    client: Policy | None, policy: str, info: PolicyInfo, space: ActionSpace
) -> tuple[Convention, ...]:
    """Return what this side and the policy's side declare.

    Args:
        client: The policy, or None for a privileged one.
        policy: Its address.
        info: What it says about itself.
        space: Action space of the run.
    """
    adapter, server = _adapter_of(client), getattr(client, "server", None)
    if adapter is not None and isinstance(server, Declaration):
        ours = replace(declare_adapter("this side", adapter, rate_hz=CONTROL_RATE_HZ), action_space=space.name)
        theirs = server
    else:
        ours, theirs = declare_space("this side", space), declare_space(policy, action_space(info.action_space))
    left, right = ours.rows(), theirs.rows()
    return tuple(Convention(n, left.get(n, ""), right.get(n, "")) for n in dict.fromkeys((*left, *right)))


def _adapter_of(client: Policy | None) -> Adapter | None:
    adapter = getattr(client, "adapter", None)
    return adapter if isinstance(adapter, Adapter) else None


class _Answers:
    """Asks several times the same, and keeps time."""

    def __init__(self, ask: Callable[[], np.ndarray], space: ActionSpace, *, ahead: int = 0) -> None:
        self._ask, self._space, self._ahead = ask, space, ahead

    def ask(self) -> tuple[np.ndarray, float, tuple[float, ...]]:
        """Return the first answer, (horizon, dim), its time and the times of those after it [s].

        Raises:
            PolicyError: If the policy breaks down.
            InvalidActionError: If an answer is no chunk of actions.
            InvalidInputError: If it is asked for further ahead than a chunk is long.
        """
        answers, times = [], []
        for _ in range(1 + REQUESTS):
            began = time.perf_counter()
            with POLICY_BOUNDARY:
                answers.append(np.asarray(self._ask()))
            times.append(time.perf_counter() - began)
        # The later ones count as well: a policy may break down when it is asked again.
        chunks = [self._checked(said) for said in answers]
        return chunks[0], times[0], tuple(times[1:])

    def _checked(self, answer: np.ndarray) -> np.ndarray:
        """Return an answer as a run would take it, (horizon, dim) float64."""
        chunk = checked_chunk(answer, self._space)
        for action in chunk:
            self._space.clip(action)
        if self._ahead >= len(chunk):
            raise InvalidInputError(
                "ahead",
                f"the next chunk is asked for {self._ahead} steps before the end, and a chunk has {len(chunk)} actions",
                "Ask less far ahead",
            )
        return chunk


def _shown(seen: Observation, adapter: Adapter | None) -> tuple[Shown, ...]:
    """Return the images as the policy gets them, with where each comes from."""
    if adapter is None:
        return tuple(Shown(name, np.asarray(p), _note(name, p, None)) for name, p in seen.images.items())
    rules = {
        rule.named(camera): (camera, rule)
        for rule in adapter.views
        for camera in (seen.images if rule.camera == EVERY_CAMERA else (rule.camera,))
    }
    return tuple(
        Shown("/".join(key), image, _note(rules[key][0], seen.images[rules[key][0]], rules[key][1]))
        for key, image in adapter.images(seen).items()
    )


def _note(camera: str, rendered: np.ndarray, rule: ImageRule | None) -> str:
    """Say where a image comes from and what was done to it."""
    height, width = rendered.shape[:2]
    said = [f"camera {camera}", f"rendered {width} x {height}"]
    if rule is None:
        return ", ".join([*said, "shown as it is"])
    if rule.turn:
        said.append(f"turned by {rule.turn} degrees")
    if rule.mirror:
        said.append("mirrored")
    if rule.keep < 1.0:
        said.append(f"the middle {rule.keep:.0%} kept")
    if rule.width is None or (rule.width, rule.height) == (width, height):
        said.append("size kept")
    else:
        said.append(f"shown {rule.width} x {rule.height} ({rule.fit})")
    return ", ".join(said)


def _state(seen: Observation, adapter: Adapter | None) -> tuple[tuple[str, np.ndarray], ...]:
    """Return the numbers that the policy gets, part by part."""
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
            values = one.read(seen, ee_offset_m=adapter.ee_offset_m, gripper_opening_m=adapter.gripper_opening_m)
            key = "/".join(rule.key)
            rows.append((key if len(rule.parts) == 1 else f"{key}: {part}", np.atleast_1d(values)))
    return tuple(rows)
