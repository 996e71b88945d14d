"""Dynamics of a robot that vary from trial to trial: servo gains, friction, rotor inertia and backlash.

Some values of a robot are borrowed from a different robot, or differ between copies of the robot. For each such
quantity, the description of the robot declares a range and states the source of the range. A trial draws one value per
joint and applies the values to a copy of the compiled model. For a robot without such ranges, the model is used
unchanged.

**Backlash** is the free play of a joint's gears. It is modeled between the reference of the position servo and the
position at which the servo holds the joint: the joint follows only after the reference has moved through the play. The
error of the joint is therefore up to half of the play, with a sign that depends on the direction of the last motion.
Dry friction keeps the joint where it stopped. In reality, a load can also move the joint within the play, which is not
modeled.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np

from betterbench.sim.robots.spec import RobotSpec
from betterbench.sim.robots.varied import BACKLASH

Dynamics = Mapping[str, tuple[float, ...]]
"""Values by quantity, with one value per joint: first the arm joints from base to flange, then the finger joints."""


def draw_dynamics(spec: RobotSpec, generator_of: Callable[[str], np.random.Generator]) -> Dynamics:
    """Draw the dynamics of one trial. The result is empty if the robot's dynamics do not vary.

    Args:
        spec: Description of the robot.
        generator_of: Function that returns the random generator of a quantity. Each quantity has its own, so that
            adding a quantity does not change the others.
    """
    count = len(spec.arm_joints) + len(spec.finger_joints)
    return {varied.quantity: varied.draw(generator_of(varied.quantity), count) for varied in spec.dynamics}


def backlash_of(spec: RobotSpec, dynamics: Dynamics) -> tuple[tuple[float, ...], float]:
    """Return half of the play of each arm joint [rad], and half of the play of the gripper in the units of its control.

    If the robot has no backlash, the result is an empty tuple and 0.
    """
    values = dynamics.get(BACKLASH, ())
    if not values:
        return (), 0.0
    return tuple(0.5 * value for value in values[: len(spec.arm_joints)]), 0.5 * values[-1]


def with_dynamics(model: mujoco.MjModel, spec: RobotSpec, dynamics: Dynamics, *, prefix: str = "") -> mujoco.MjModel:
    """Return a copy of a model in which the robot has the given dynamics. If there are none, return the model itself.

    Derived constants are computed again, except the extent of the scene, because the clipping planes of the cameras
    depend on it.

    Args:
        model: Model that contains the robot.
        spec: Description of the robot.
        dynamics: Values by quantity. The backlash is not part of the model (see :class:`ArmController`).
        prefix: Prefix of the robot's names in the model.
    """
    factors = {name: values for name, values in dynamics.items() if name != BACKLASH}
    if not factors:
        return model
    made = copy.copy(model)
    joints = (*spec.arm_joints, *spec.finger_joints)
    dofs = [int(made.joint(prefix + name).dofadr[0]) for name in joints]
    for quantity, array in (
        ("joint_damping", made.dof_damping),
        ("joint_friction", made.dof_frictionloss),
        ("joint_armature", made.dof_armature),
    ):
        _scale(array, dofs, factors.get(quantity, ()))
    arm = len(spec.arm_joints)
    pull = [int(made.actuator(prefix + name).id) for name in (*spec.position_actuators, spec.gripper_actuator)]
    damp = [int(made.actuator(prefix + name).id) for name in spec.velocity_actuators]
    stiffness, damping = (factors.get(name, ()) for name in ("servo_stiffness", "servo_damping"))
    _scale(made.actuator_gainprm[:, 0], pull, stiffness)
    _scale(made.actuator_biasprm[:, 1], pull, stiffness)
    _scale(made.actuator_gainprm[:, 0], damp, damping[:arm])
    _scale(made.actuator_biasprm[:, 2], [*damp, pull[-1]], damping)
    extent, center = float(made.stat.extent), made.stat.center.copy()
    mujoco.mj_setConst(made, mujoco.MjData(made))
    made.stat.extent, made.stat.center = extent, center
    return made


def _scale(array: np.ndarray, indices: Sequence[int], factors: Sequence[float]) -> None:
    """Multiply the elements at the given indices by the factors. Do nothing if there are no factors."""
    for index, factor in zip(indices, factors, strict=False):
        array[index] *= factor
