"""Inverse kinematics: one control step toward a pose, and joint angles that reach a pose.

Planning (:meth:`ArmIK.reach`) takes frame errors, Jacobians and forward kinematics from mink (:class:`mink.FrameTask`,
:class:`mink.Configuration`), on a model of the arm alone. The control step (:meth:`ArmIK.solve`) runs only 20 times per
simulated second, so the CPU caches are cold each time. To save time, it computes the same Jacobian directly with
MuJoCo, in the base frame. A test compares the two Jacobians. The quadratic program is assembled here and passed to
DAQP, with the limits as simple bounds. Mink's own interface to the solver passes the limits as 28 general inequalities,
which takes about three times as long.

Each iteration minimizes over the joint step ``d``

    |W (J d - e)|^2  +  posture^2 |q + d - home|^2  +  damping |d|^2

inside the position and velocity limits. The posture term is a million times weaker than the pose term, so it moves the
elbow but displaces the tool only by micrometers. Results depend only on the arguments, because nothing is stored
between calls.
"""

from __future__ import annotations

import functools
import importlib
import math
import operator
import sys
import types
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import daqp  # type: ignore[import-not-found]
import mujoco
import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import Pose, Quaternion, angle_between, distance, to_axis_angle, turn_between
from betterbench.sim.robots.readers import number_reader, number_writer, numbers_of
from betterbench.sim.robots.spec import RobotSpec, build_robot_spec

POSITION_COST = 1.0
"""Weight of a position error [1/m]."""

FOLLOW_ITERATIONS = 6
"""Number of Newton steps after which :meth:`ArmIK.follow` falls back to :meth:`ArmIK.reach`.

One or two usually suffice.
"""

LIMIT_MARGIN_RAD = 0.06
"""Distance that references keep from the joint limits [rad]. It is larger than the overshoot of the moving arm."""

APPROACH = 0.5
"""Maximum fraction of the remaining distance to a position limit that a joint may move in one control step."""

_FAR = 1.01 / APPROACH
"""Distance from a position limit, in steps at full speed, beyond which the limit is never active (with a margin)."""

SECOND_ITERATION_RAD = 0.03
"""Joint step above which a control step takes a second iteration, with the new error and the first Jacobian [rad].

Below it (about 2 cm at the tool), the first iteration leaves less than 0.4 mm, which the next control step corrects.
For a step of 3 cm, the second iteration reduces the error to 0.1 mm.
"""

_REACH_STEP_RAD = 0.3
"""Largest joint step in one iteration of :meth:`ArmIK.reach` [rad]."""

_Window = tuple[Sequence[float], Sequence[float], float]
"""Joint angles at the start of a control step, and the center and half width of the range allowed by the lead [rad]."""


@dataclass(frozen=True, slots=True)
class IKResult:
    """Joint angles (n,) [rad] that were found for a pose, and their remaining errors. The array is read-only.

    ``converged`` tells whether both errors are within the requested tolerances. ``iterations`` is the total number of
    iterations over all starts of the search.
    """

    q: np.ndarray
    position_error_m: float
    rotation_error_rad: float
    converged: bool
    iterations: int


class ArmIK:
    """Inverse kinematics of one robot's arm. All poses are ``T_base_tcp``."""

    def __init__(self, spec: RobotSpec) -> None:
        """Compile the model of the arm (once per process and robot) and prepare the solver."""
        self.spec = spec
        self._model, site = _arm_model(spec)
        self._data = mujoco.MjData(self._model)
        self._site = site
        self.home = np.array(spec.home_joints)
        self.low = np.array(spec.joint_low) + LIMIT_MARGIN_RAD
        self.high = np.array(spec.joint_high) - LIMIT_MARGIN_RAD
        self._speed = np.array(spec.joint_velocity) * spec.control_period_s
        n = len(spec.arm_joints)
        self._error, self._jacobian = np.zeros(6), np.zeros((6, n))
        self._none = np.zeros((0, n))
        self._sense = np.zeros(n, dtype=np.int32)
        self._factor = np.zeros((n, n))
        self._quaternion = np.zeros(4)
        self._site_position, self._site_matrix = self._data.site_xpos[site], self._data.site_xmat[site]
        self._bounds = tuple(zip(self.low.tolist(), self.high.tolist(), self._speed.tolist(), strict=True))
        self._roomy = tuple((low + _FAR * v, high - _FAR * v, v) for low, high, v in self._bounds)
        self._home = self.home.tolist()
        self._gradient, self._newton = np.zeros(n), np.zeros(n)
        costs = spec.ik
        self._turn = costs.orientation * costs.orientation
        self._posture = costs.posture * costs.posture
        self._slack = costs.rotation_slack_rad
        self._step_weight, self._reach_damping = self._posture + costs.step_damping, costs.reach_damping
        self._weights = np.array([1.0] * 3 + [self._turn] * 3)
        self._translation, self._rotation = self._jacobian[:3], self._jacobian[3:]
        self._set_joints, self._set_error = number_writer(self._data.qpos), number_writer(self._error)
        self._set_gradient = number_writer(self._gradient)
        self._get_gradient, self._get_newton = (number_reader(a, range(n)) for a in (self._gradient, self._newton))
        self._get_position = number_reader(self._site_position, range(3))
        self._get_quaternion = number_reader(self._quaternion, range(4))
        self._factor_numbers = numbers_of(self._factor)
        self._diagonal = tuple(range(0, n * n, n + 1))

    @functools.cached_property
    def _frame(self) -> _FrameProblem:
        """Pose error and Jacobian computed by mink. They are used for planning, but not for control steps."""
        return _FrameProblem(self._model, self.spec.tcp_site, self.spec.ik.orientation)

    def forward(self, q: Sequence[float] | np.ndarray) -> Pose:
        """Return the pose ``T_base_tcp`` at the joint angles ``q`` (n,) [rad]."""
        self._place(q)
        return self._tcp()

    def solve(
        self, q: np.ndarray, target: Pose, *, around: np.ndarray | None = None, lead_rad: float = 0.0
    ) -> np.ndarray:
        """Return the joint angles (n,) [rad] after one control step from ``q`` toward a pose ``T_base_tcp``.

        The result stays within the limits of position and velocity. If ``q`` is outside these limits, the result comes
        as close to them as one step allows. If ``around`` is given, the result also stays within ``lead_rad`` of it.
        """
        centers = None if around is None else around.tolist()
        return np.array(self.step(q.tolist(), target, around=centers, lead_rad=lead_rad))

    def step(
        self, q: Sequence[float], target: Pose, *, around: Sequence[float] | None = None, lead_rad: float = 0.0
    ) -> list[float]:
        """Return the same joint angles as :meth:`solve`, as plain numbers.

        The method uses plain floats, plain loops and MuJoCo's own small functions, because it runs between two physics
        steps, when the CPU caches are cold. An array operation then takes three times as long as in an isolated
        benchmark, and `all` and `map` take twice as long as a loop.
        """
        centers = q if around is None else around
        lead = math.inf if around is None else lead_rad
        self._place(q)
        self._factorize(self._step_weight)
        moved, farthest = self._descent(q, target, (q, centers, lead))
        if farthest > SECOND_ITERATION_RAD:
            self._place(moved)
            moved, _ = self._descent(moved, target, (q, centers, lead))
        return moved

    def window(
        self, q: Sequence[float], centers: Sequence[float], lead_rad: float = math.inf
    ) -> tuple[list[float], list[float]]:
        """Return the lowest and the highest joint references that are allowed one control step after ``q``.

        All arguments and results are angles of the n joints [rad]. In one step, a joint obeys its velocity limit. It
        also covers at most the fraction :data:`APPROACH` of its distance to a position limit, so that it slows down
        before the limit. A joint outside its limits must return by at least this fraction, as far as its velocity limit
        permits. Within these bounds, a reference stays within ``lead_rad`` of ``centers``.
        """
        lowest: list[float] = []
        highest: list[float] = []
        for now, center, (low, high, speed) in zip(q, centers, self._bounds, strict=True):
            down, up = APPROACH * (low - now), APPROACH * (high - now)
            down = now + (-speed if down < -speed else min(down, speed))
            up = now + (speed if up > speed else max(up, -speed))
            down = min(max(down, center - lead_rad), up)
            up = max(min(up, center + lead_rad), down)
            lowest.append(down)
            highest.append(up)
        return lowest, highest

    def _reach_in_window(self, moved: Sequence[float], window: _Window) -> float | None:
        """Return the largest step of any joint [rad], or None if an angle is outside the range of :meth:`window`."""
        q, centers, lead = window
        farthest = 0.0
        # Far from its position limits, a joint is limited only by its speed and its lead.
        for x, now, center, (low, high, speed) in zip(moved, q, centers, self._roomy, strict=True):
            step = abs(x - now)
            if not (low <= now <= high and step <= speed and abs(x - center) <= lead):
                break
            if step > farthest:  # noqa: PLR1730 - less than a call of max
                farthest = step
        else:
            return farthest
        lowest, highest = self.window(q, centers, lead)
        if not all(least <= x <= most for least, x, most in zip(lowest, moved, highest, strict=True)):
            return None
        return largest_step(moved, q)

    def reach(
        self,
        q: np.ndarray,
        target: Pose,
        *,
        position_tolerance_m: float = 1e-4,
        rotation_tolerance_rad: float = 1e-3,
        iterations: int = 60,
        restarts: bool = True,
    ) -> IKResult:
        """Search for joint angles that reach ``T_base_tcp``. Return the first converged result, or else the best.

        The search starts at ``q`` (n,) [rad]. If ``restarts`` is True, it continues from fixed postures around the home
        posture. It takes at most ``iterations`` per start. A rotation error of at most the robot's
        ``rotation_slack_rad`` is accepted. In that case, the search reaches the position exactly and makes the rotation
        error as small as possible. Raises InvalidInputError if ``q`` has a wrong shape or is not finite.
        """
        start = np.asarray(q, dtype=np.float64)
        if start.shape != self.home.shape or not np.isfinite(start).all():
            raise InvalidInputError(
                "start of the inverse kinematics",
                f"{start!r} is not a valid joint vector",
                f"Pass {self.home.size} finite angles",
            )
        starts = [start]
        self._frame.aim(target)
        if restarts:
            starts += [self.home + np.array(offset) for offset in self.spec.posture_offsets]
        best: IKResult | None = None
        used = 0
        for first in starts:
            inside = np.minimum(np.maximum(first, self.low), self.high)
            found = self._descend(inside, target, position_tolerance_m, rotation_tolerance_rad, iterations)
            used += found.iterations
            if best is None or (found.converged, -self._error_of(found)) > (best.converged, -self._error_of(best)):
                best = found
            if best.converged:
                break
        if best is None:
            raise AssertionError("the list of starts is never empty")
        return IKResult(best.q, best.position_error_m, best.rotation_error_rad, best.converged, used)

    def follow(
        self, q: Sequence[float], target: Pose, *, position_tolerance_m: float, rotation_tolerance_rad: float
    ) -> list[float] | None:
        """Return joint angles (n,) near ``q`` [rad] that bring the tool to ``T_base_tcp``, or None if there are none.

        This is meant for many consecutive targets along a path. It starts close to the solution and takes Newton steps
        until both tolerances are met, which takes a tenth of the time of :meth:`reach`. If the steps leave the limits
        or do not converge, :meth:`reach` searches from ``q``. If ``q`` is outside the limits, the search starts from
        the nearest angles inside them.
        """
        now = [min(max(angle, low), high) for angle, (low, high, _) in zip(q, self._bounds, strict=True)]
        last = math.inf
        for _ in range(FOLLOW_ITERATIONS):
            self._place(now)
            x, y, z, rx, ry, rz = self._world_error(target)
            turn = math.hypot(rx, ry, rz)
            if math.hypot(x, y, z) <= position_tolerance_m and (
                turn <= rotation_tolerance_rad or (turn <= self._slack and abs(turn - last) <= rotation_tolerance_rad)
            ):
                return now
            last = turn
            self._factorize(self._posture + self._reach_damping)
            now = self._newton_step(now, (x, y, z, rx, ry, rz))
            if not all(low <= angle <= high for angle, (low, high, _) in zip(now, self._bounds, strict=True)):
                break
        found = self.reach(
            np.array(q), target, restarts=False,
            position_tolerance_m=position_tolerance_m, rotation_tolerance_rad=rotation_tolerance_rad,
        )  # fmt: skip
        return found.q.tolist() if found.converged else None

    def _descend(self, q: np.ndarray, target: Pose, position: float, rotation: float, iterations: int) -> IKResult:
        """Iterate from one start until the pose is reached or no more progress is made."""
        settled = 0
        count = 0
        position_error = rotation_error = math.inf
        while count < iterations and settled < 3:
            count += 1
            low = np.maximum(self.low, q - _REACH_STEP_RAD)
            high = np.minimum(self.high, q + _REACH_STEP_RAD)
            before = q
            q = self._step(q, low, high, self._linearise(q, self._reach_damping))
            tcp = self.forward(q)
            position_error = distance(tcp.position, target.position)
            rotation_error = angle_between(tcp.quaternion, target.quaternion)
            if position_error < 0.1 * position and rotation_error < 0.1 * rotation:
                break
            settled = settled + 1 if float(np.abs(q - before).max()) < 1e-4 else 0
        q.setflags(write=False)
        allowed = max(rotation, self._slack)
        return IKResult(
            q, position_error, rotation_error, position_error <= position and rotation_error <= allowed, count
        )

    def _error_of(self, result: IKResult) -> float:
        """Return the weighted error of a result.

        It is used to compare starts from which the search did not converge.
        """
        return POSITION_COST * result.position_error_m + self.spec.ik.orientation * result.rotation_error_rad

    def _place(self, q: Sequence[float] | np.ndarray) -> None:
        """Set the joint angles (n,) [rad] and update the poses, but not the data that are needed for Jacobians."""
        self._set_joints(*q)
        mujoco.mj_kinematics(self._model, self._data)

    def _world_error(self, target: Pose) -> tuple[float, float, float, float, float, float]:
        """Return the pose error in the base frame: position [m], then rotation vector [rad]."""
        x, y, z = target.position
        px, py, pz = self._get_position()
        rotation = to_axis_angle(turn_between(self._site_quaternion(), target.quaternion))
        return (x - px, y - py, z - pz, *rotation)

    def _world_jacobian(self) -> np.ndarray:
        """Return the Jacobian (6, n) of the tool in the base frame at the current joint angles."""
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jacSite(self._model, self._data, self._translation, self._rotation, self._site)
        return self._jacobian

    def _factorize(self, weight: float) -> None:
        """Prepare Newton steps at the current joint angles. ``weight`` is the cost of joint motion."""
        factor = self._factor
        mujoco.mju_sqrMatTD(factor, self._world_jacobian(), self._weights)
        numbers = self._factor_numbers
        for diagonal in self._diagonal:
            numbers[diagonal] += weight
        mujoco.mju_cholFactor(factor, 0.0)

    def _descent(self, q: Sequence[float], target: Pose, window: _Window) -> tuple[list[float], float]:
        """Return the joint angles [rad] after one iteration from ``q``, with the last computed Jacobian.

        Also return the largest distance between a joint angle and its value at the start of the control step [rad].
        """
        # If no bound is active, the minimum is one Newton step, which takes a third of the time of the quadratic
        # program.
        moved = self._newton_step(q, self._world_error(target))
        reach = self._reach_in_window(moved, window)
        if reach is not None:
            return moved, reach
        hessian = np.empty_like(self._factor)
        mujoco.mju_sqrMatTD(hessian, self._jacobian, self._weights)
        hessian.ravel()[:: len(q) + 1] += self._step_weight
        now, low, high = np.array(q), *map(np.array, self.window(*window))
        inside: list[float] = self._bounded_step(now, low, high, hessian, -self._gradient).tolist()
        return inside, largest_step(inside, window[0])

    def _newton_step(self, q: Sequence[float], error: tuple[float, float, float, float, float, float]) -> list[float]:
        """Return the joint angles [rad] after one unbounded step from ``q``, which :meth:`_factorize` has prepared."""
        x, y, z, rx, ry, rz = error
        turn, posture = self._turn, self._posture
        self._set_error(x, y, z, turn * rx, turn * ry, turn * rz)
        mujoco.mju_mulMatTVec(self._gradient, self._jacobian, self._error)
        pulls = zip(self._get_gradient(), q, self._home, strict=True)
        self._set_gradient(*[g - posture * (now - home) for g, now, home in pulls])
        mujoco.mju_cholSolve(self._newton, self._factor, self._gradient)
        return list(map(operator.add, q, self._get_newton()))  # this takes two thirds of the time of a loop

    def _linearise(self, q: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the Hessian (n, n), the weighted Jacobian (6, n) and the weighted pose error (6,) at ``q`` [rad]."""
        jacobian, error = self._frame.residual(q)
        hessian = jacobian.T.dot(jacobian)
        hessian.ravel()[:: len(q) + 1] += self._posture + damping
        return hessian, jacobian, error

    def _step(
        self, q: np.ndarray, low: np.ndarray, high: np.ndarray, problem: tuple[np.ndarray, np.ndarray, np.ndarray]
    ) -> np.ndarray:
        """Return the joint angles (n,) [rad] after one step of the quadratic program inside the bounds."""
        hessian, jacobian, error = problem
        gradient = self._posture * (q - self.home) - error.dot(jacobian)
        return self._bounded_step(q, low, high, hessian, gradient)

    def _bounded_step(
        self, q: np.ndarray, low: np.ndarray, high: np.ndarray, hessian: np.ndarray, gradient: np.ndarray
    ) -> np.ndarray:
        """Minimize a quadratic function of the joint step within the bounds, and return the resulting joint angles."""
        step, _, flag, _ = daqp.solve(hessian, gradient, self._none, high - q, low - q, self._sense)
        if flag < 1:
            # The bounds never cross and the Hessian is positive definite, so the failure is a numerical one. The arm
            # does not move in this step.
            step = np.zeros_like(q)
        moved: np.ndarray = np.minimum(np.maximum(q + step, low), high)
        return moved

    def _tcp(self) -> Pose:
        """Return the tool pose at the current joint angles."""
        return Pose(self._get_position(), self._site_quaternion())

    def _site_quaternion(self) -> Quaternion:
        """Return the tool rotation at the current joint angles."""
        mujoco.mju_mat2Quat(self._quaternion, self._site_matrix)
        w, x, y, z = self._get_quaternion()
        return (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)


class _FrameProblem:
    """Pose error of the tool and its Jacobian, computed by mink.

    It has its own data, so that planning does not change the data of the control step.
    """

    def __init__(self, model: mujoco.MjModel, site: str, orientation_cost: float) -> None:
        # mink is imported here because only planning needs it.
        with _loaded_when_used("qpsolvers", annotation="Problem"):
            import mink  # noqa: PLC0415

        self._configuration = mink.Configuration(model)
        self._task = mink.FrameTask(site, "site", position_cost=POSITION_COST, orientation_cost=orientation_cost)
        # The task keeps the target as one array (w, x, y, z, px, py, pz), which is written in place.
        target = mink.SE3(wxyz_xyz=np.array(mink.SE3.identity().wxyz_xyz))
        self._task.transform_target_to_world = target
        self._target: np.ndarray = target.wxyz_xyz

    def aim(self, target: Pose) -> None:
        """Set the target pose ``T_base_tcp``."""
        self._target[:] = (*target.quaternion, *target.position)

    def residual(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the weighted Jacobian (6, n) and the weighted pose error (6,) at the joint angles ``q`` [rad]."""
        self._configuration.update(q)
        jacobian, error, _ = self._task.compute_qp_residual(self._configuration)
        return jacobian, error


@contextmanager
def _loaded_when_used(name: str, *, annotation: str) -> Iterator[None]:
    """Context manager in which an import of the module ``name`` returns a stand-in.

    The stand-in loads the module when it is first used.

    ``annotation`` is an attribute that the importing code reads only to annotate a function. Reading it does not load
    the module.

    mink imports qpsolvers, which imports scipy.sparse. This takes 0.2 s of CPU time in each worker, and twice as much
    where Python writes no bytecode. Only mink's own solver uses qpsolvers, and betterbench does not call this solver.
    """
    if name in sys.modules:
        yield
        return
    stand_in = types.ModuleType(name)

    def leave() -> None:
        if sys.modules.get(name) is stand_in:
            del sys.modules[name]

    def load(attribute: str) -> object:
        leave()
        return getattr(importlib.import_module(name), attribute)

    stand_in.__dict__.update({"__getattr__": load, annotation: None})
    sys.modules[name] = stand_in
    try:
        yield
    finally:
        delattr(stand_in, annotation)
        leave()


def largest_step(moved: Sequence[float], q: Sequence[float]) -> float:
    """Return the largest change of any joint angle [rad]."""
    return max(abs(x - now) for x, now in zip(moved, q, strict=True))


@functools.cache
def _arm_model(spec: RobotSpec) -> tuple[mujoco.MjModel, int]:
    """Return the model of the arm alone, with fixed fingers, and the index of its tool site."""
    description = build_robot_spec(spec.name, visuals=False)
    for group in (description.actuators, description.tendons, description.equalities, description.excludes):
        for element in list(group):
            description.delete(element)
    for joint in list(description.joints):
        if joint.name not in spec.arm_joints:
            description.delete(joint)
    for geom in list(description.geoms):
        description.delete(geom)
    model = description.compile()
    names = tuple(model.joint(i).name for i in range(model.njnt))
    if names != spec.arm_joints:
        raise InvalidInputError(
            f"robot {spec.name!r}", f"its model has the joints {names}", f"Define them in the order {spec.arm_joints}"
        )
    return model, int(model.site(spec.tcp_site).id)
