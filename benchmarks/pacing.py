"""Measuring an episode from inside, by a policy that plays given actions and runs a reference in between.

The library's own loop, :func:`betterbench.episodes.run_episode`, is timed, and not a copy of it. The time runs from the
moment when the policy returns an action to the request for the next action. It includes the controller, the physics,
the privileged state, the predicates, the record and, with an observer, the images: everything but the policy. After
every few control steps, the policy runs the reference for the same number of steps, so that the load of the machine is
the same for both.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.interface.actions import action_space
from betterbench.interface.state import WorldState
from betterbench.policies.experts import make_expert
from betterbench.records import Record
from betterbench.sim.scenes import Scene, renderer_fingerprint
from betterbench.sim.scenes.stage import Quality
from betterbench.tasks import GoalTracker, get_task

CONTEXT = TrialContext(
    policy="bench", variation=None, axis=None, base_condition=None, interventions=(), camera_preset=None
)

HEAVIEST = "breakfast_table"
"""The task with the most objects, contacts and faces."""

PICTURE_TASK = "fast_food"
"""Task of the rows that measure one task only."""

PICTURE_TASKS = (PICTURE_TASK, HEAVIEST)
"""Tasks of the rows with images."""

BLOCK = 40
"""Control steps between two runs of the reference, 2 s of the episode. At the start of each run, the caches contain the
other side's data, which does not happen in an episode. With 10 steps, the ratio of `step` is 0.01 to 0.02 higher."""

PICTURE_BLOCK = 10
"""The same number for rows with images, in which a control step takes twenty times as long."""

Reference = Callable[[int, int], float]
"""``reference(first, last)`` runs control steps ``first`` to ``last - 1`` in its own way and returns the seconds."""


class EnoughMeasured(BaseException):
    """Raised by a policy to leave the loop, which only catches subclasses of Exception."""


class ReferenceFailed(BaseException):
    """Carries an error of the reference out of the loop, in which an Exception of the policy only ends the trial."""

    def __init__(self, error: Exception) -> None:
        super().__init__(str(error))
        self.error = error


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """An episode of the expert that is played again.

    Attributes:
        scene: The scene; every repetition resets it.
        record: Record of the episode; a repetition is equal to it, bit for bit.
    """

    scene: Scene
    record: Record

    @property
    def actions(self) -> np.ndarray:
        """(T, 7) actions."""
        return self.record.action[1:]

    @property
    def controls(self) -> np.ndarray:
        """(T, nu) actuator commands, the only effect of the actions on the physics."""
        return self.record.ctrl[1:]


def rehearse(task_name: str, quality: Quality, *, seed: int = 0) -> Rehearsal:
    """Let the expert solve a task's first training condition once, which also fills all caches.

    Args:
        task_name: Task id.
        quality: Render quality of the scene.
        seed: Seed of the trial.
    """
    task = get_task(task_name)
    scene = Scene(task, task.training[0], seed=seed, action_space=action_space("ee_delta"), quality=quality)
    return Rehearsal(scene, run_episode(scene, make_expert("expert", scene), context=CONTEXT).record)


@dataclass(slots=True)
class PacedMind:
    """A policy that plays actions and runs a reference in between. It works with and without observations.

    Attributes:
        actions: (T, 7) actions to play.
        reference: Function to compare with.
        every: Control steps between two runs of the reference.
        limit: Control steps after which the episode is stopped.
        own_s: Seconds that the loop took for each block of ``every`` control steps.
        reference_s: Seconds that the reference took for each block.
    """

    actions: np.ndarray
    reference: Reference
    every: int
    limit: int
    own_s: list[float] = field(default_factory=list)
    reference_s: list[float] = field(default_factory=list)
    _step: int = 0
    _block_s: float = 0.0
    _left: float = 0.0

    info = PolicyInfo("bench", needs_images=True)
    name = "bench"

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode; there is nothing to prepare."""

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next action, shape (7,)."""
        del observation
        return self._turn()

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action, shape (7,)."""
        del state
        return self._turn()

    def _turn(self) -> np.ndarray:
        step = self._step
        if step:
            self._block_s += time.perf_counter() - self._left
            if step % self.every == 0:
                self.own_s.append(self._block_s)
                self._block_s = 0.0
                try:
                    self.reference_s.append(self.reference(step - self.every, step))
                except Exception as error:
                    raise ReferenceFailed(error) from error
        if step >= min(self.limit, len(self.actions)):
            raise EnoughMeasured
        action: np.ndarray = self.actions[step]
        self._step += 1
        self._left = time.perf_counter()
        return action


def play(rehearsal: Rehearsal, reference: Reference, *, every: int, limit: int, observer: Observer | None) -> PacedMind:
    """Play a rehearsed episode in the library's loop and return the policy with the measured times.

    Args:
        rehearsal: The episode.
        reference: Function to compare with.
        every: Control steps between two runs of the reference.
        limit: Control steps after which the episode is stopped.
        observer: Makes the images, or None.

    Raises:
        Exception: Whatever the reference raises.
    """
    policy = PacedMind(rehearsal.actions, reference, every, limit)
    try:
        with contextlib.suppress(EnoughMeasured):
            run_episode(rehearsal.scene, policy, context=CONTEXT, observer=observer)
    except ReferenceFailed as failed:
        raise failed.error from None
    return policy


class RawPhysics:
    """Only ``mj_step`` on the same model, from the same state, with the same actuator commands.

    After each run, the state is compared with the record, so both sides have computed the same contacts.
    """

    def __init__(
        self,
        rehearsal: Rehearsal,
        *,
        views: RawViews | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Prepare a separate state.

        Args:
            rehearsal: The episode.
            views: Images to draw after each control step, or None.
            clock: Clock in seconds.
        """
        self._rehearsal, self._views, self._clock = rehearsal, views, clock
        self._model = rehearsal.scene.model
        self._data = mujoco.MjData(self._model)

    def __call__(self, first: int, last: int) -> float:
        """Run control steps ``first`` to ``last - 1`` and return the seconds.

        Raises:
            ValueError: If the motion differs, because the times then cannot be compared.
        """
        scene, record = self._rehearsal.scene, self._rehearsal.record
        model, data, views, substeps = self._model, self._data, self._views, scene.physics_steps
        if first == 0:
            fresh = Scene(
                scene.task, scene.condition, seed=scene.seed, action_space=scene.action_space, quality=scene.quality
            )
            mujoco.mj_copyData(data, model, fresh.data)
        controls = self._rehearsal.controls
        began = self._clock()
        for step in range(first, last):
            data.ctrl[:] = controls[step]
            mujoco.mj_step(model, data, nstep=substeps)
            if views is not None:
                views.draw(data)
        seconds = self._clock() - began
        if not np.array_equal(data.qpos, record.qpos[last]):
            raise ValueError(f"the raw physics took another course before control step {last}")
        return seconds

    def go_on(self, steps: int) -> float:
        """Run control steps after the end of the record, with its last command, and return the seconds."""
        began = self._clock()
        for _ in range(steps):
            mujoco.mj_step(self._model, self._data, nstep=self._rehearsal.scene.physics_steps)
        return self._clock() - began


class SleeplessEpisode:
    """The same actions in a separate scene in which no object sleeps, to measure a control step without sleeping."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        """Prepare a separate scene with the same model."""
        self._rehearsal = rehearsal
        s = rehearsal.scene
        self._scene = Scene(s.task, s.condition, seed=s.seed, action_space=s.action_space, quality=s.quality)
        self._tracker = self._new_tracker()

    def _new_tracker(self) -> GoalTracker:
        s = self._scene
        return GoalTracker(s.condition, s.info, template=s.task.template, control_rate_hz=s.control_rate_hz)

    def __call__(self, first: int, last: int) -> float:
        """Run control steps ``first`` to ``last - 1`` and return the seconds."""
        scene = self._scene
        options, flag = scene.model.opt, int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        if first == 0:
            self._tracker = self._new_tracker()
            self._tracker.update(scene.reset())
        options.enableflags &= ~flag
        try:
            began = time.perf_counter()
            for action in self._rehearsal.actions[first:last]:
                scene.step(action)
                self._tracker.update(scene.state())
            return time.perf_counter() - began
        finally:
            options.enableflags |= flag


class RawViews:
    """The same views, drawn only by MuJoCo's own functions."""

    def __init__(self, model: mujoco.MjModel, quality: Quality, cameras: Sequence[str], *, size: int = 256) -> None:
        """Upload the model into separate buffers.

        Args:
            model: Compiled model.
            quality: Render quality.
            cameras: Names of the cameras.
            size: Width and height [pixel].
        """
        renderer_fingerprint()  # makes the process's OpenGL context current, which this one shares
        visual = model.vis
        kept = visual.global_.offwidth, visual.global_.offheight, visual.quality.offsamples, visual.quality.shadowsize
        visual.global_.offwidth = visual.global_.offheight = size
        visual.quality.offsamples, visual.quality.shadowsize = quality.samples, quality.shadow_map_size
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
        visual.global_.offwidth, visual.global_.offheight, visual.quality.offsamples, visual.quality.shadowsize = kept
        self._model, self._scene = model, mujoco.MjvScene(model, maxgeom=model.ngeom + 16)
        self._option = mujoco.MjvOption()
        self._option.flags[:] = 0
        self._option.flags[mujoco.mjtVisFlag.mjVIS_TEXTURE] = 1
        self._option.flags[mujoco.mjtVisFlag.mjVIS_STATIC] = 1
        self._option.sitegroup[:] = 0
        self._scene.flags[:] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 1
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = int(quality.shadows)
        self._cameras = []
        for name in cameras:
            camera = mujoco.MjvCamera()
            camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera(name).id
            self._cameras.append(camera)
        self._view = mujoco.MjrRect(0, 0, size, size)
        self.pixels = [np.empty((size, size, 3), np.uint8) for _ in cameras]

    def draw(self, data: mujoco.MjData) -> None:
        """Draw all views into :attr:`pixels`, bottom row first.

        Args:
            data: State to show.
        """
        mujoco.mjr_setBuffer(int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN), self._context)
        for camera, pixels in zip(self._cameras, self.pixels, strict=True):
            mujoco.mjv_updateScene(
                self._model, data, self._option, None, camera, int(mujoco.mjtCatBit.mjCAT_ALL), self._scene
            )
            mujoco.mjr_render(self._view, self._scene, self._context)
            mujoco.mjr_readPixels(pixels, None, self._view, self._context)

    def close(self) -> None:
        """Free the buffers."""
        self._context.free()
