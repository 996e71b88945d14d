"""Policy kind ``independent``: faulty policies from a separate package (betterbench-calibration)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import AddressForm, PolicyAddress
from betterbench.policies.kinds.kind import STATE, PlannedTrial, PolicyKind, register
from betterbench.policies.kinds.privileged import describe_privileged, needs_own_scenes, own_scene

if TYPE_CHECKING:
    from types import ModuleType

    from betterbench.interface.state import PrivilegedPolicy
    from betterbench.sim.worlds import TrialScene

_FORM = AddressForm(scheme="independent", example="independent:HABIT-MANNER")


def _family(address: str) -> ModuleType:
    """Return the module with the registry of independent faulty policies.

    If its package is not installed, raise an error that contains the command to install the package.
    """
    from betterbench.installation import calibration_module

    problem = f"{address} is a policy of the independent family, which needs betterbench-calibration"
    return calibration_module("independent.registry", problem)


def _read(text: str, world: str) -> PolicyAddress:
    address = _FORM.read(text, world=world)
    _family(text).policy_of(text)
    return address


def _make_for(address: PolicyAddress, scene: TrialScene, trial: PlannedTrial | None) -> PrivilegedPolicy:
    del trial
    made: PrivilegedPolicy = _family(address.text).make_independent(address.text, own_scene(address, scene))
    return made


def _require_world(address: PolicyAddress, world: str) -> None:
    raise needs_own_scenes(address, "uses the privileged state", world)


INDEPENDENT = register(
    PolicyKind(
        form=_FORM,
        shown="independent:HABIT-MANNER",
        summary="A faulty policy whose author did not know the diagnosis.",
        needs=STATE,
        read=_read,
        make_for=_make_for,
        describe=describe_privileged,
        require_world=_require_world,
    )
)
