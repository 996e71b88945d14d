"""Physics options and control rates that all models share, including scenes, robots and single assets."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from betterbench.interface.actions import CONTROL_RATE_HZ


@dataclass(frozen=True, slots=True)
class Physics:
    """Options of MuJoCo's compiler and solver, and the default contact parameters.

    Attributes:
        timestep_s: Duration of one physics step [s].
        control_rate_hz: Number of actions per second [Hz]. A control step is an integer number of physics steps.
        impratio: Ratio of frictional to normal constraint impedance. Values above 1 reduce the creep of held objects.
        noslip_iterations: Iterations of the solver that removes the remaining creep.
        condim: Contact dimensions. With 4, there is torsional friction, which prevents a flat object from rotating
            between two pads.
        contact_time_constant_s: Time constant of critically damped contacts [s]. An object that is dropped from 5 cm
            arrives at 1 m/s. With MuJoCo's default of 20 ms, it would sink by 7 mm, through the floor of a box. With 5
            ms, which is still 2.5 time steps, it sinks by 2 mm.
        sleep_tolerance_m_s: Speed below which a group of touching objects falls asleep after ten time steps [m/s].
            Rotation is weighted by the object's size. The value is a twentieth of the speed below which a verdict
            considers an object at rest, so no motion that affects a verdict is stopped.
    """

    timestep_s: float = 0.002
    control_rate_hz: float = CONTROL_RATE_HZ
    impratio: float = 10.0
    noslip_iterations: int = 3
    condim: int = 4
    contact_time_constant_s: float = 0.005
    sleep_tolerance_m_s: float = 0.001

    def set_solver(self, spec: mujoco.MjSpec) -> None:
        """Write the compiler and solver options to a model description."""
        spec.compiler.degree = False
        spec.compiler.autolimits = True
        spec.option.timestep = self.timestep_s
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = self.impratio
        spec.option.noslip_iterations = self.noslip_iterations

    def set_scene(self, spec: mujoco.MjSpec) -> None:
        """Write the solver and sleeping options and the default contact parameters to the description of a scene."""
        self.set_solver(spec)
        spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        spec.option.sleep_tolerance = self.sleep_tolerance_m_s
        spec.default.geom.condim = self.condim
        spec.default.geom.solref = [self.contact_time_constant_s, 1.0]


PHYSICS = Physics()
