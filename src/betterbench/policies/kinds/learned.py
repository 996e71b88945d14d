"""Policy kind ``learned``: learners trained by ``better train``.

Learners of the family ``pixels`` use observations. All others use the privileged state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import AddressForm, Option, PolicyAddress
from betterbench.policies.kinds.kind import AT_ONCE, STATE, PlannedTrial, PolicyKind, PolicyNeeds, register
from betterbench.policies.kinds.privileged import needs_own_scenes, own_scene

if TYPE_CHECKING:
    from pathlib import Path

    from betterbench.interface import Policy, PolicyInfo
    from betterbench.interface.state import PrivilegedPolicy
    from betterbench.sim.worlds import TrialScene

_FORM = AddressForm(
    scheme="learned",
    example="learned:CHECKPOINT",
    options=(
        Option(
            "execute",
            "the execution horizon: the number of actions of a chunk that are executed before the learner "
            "answers again",
            "whole",
        ),
    ),
)


def learned_address(checkpoint: Path) -> str:
    """Return the policy address of a learner's checkpoint."""
    return f"{_FORM.scheme}:{checkpoint}"


def _needs(address: PolicyAddress) -> PolicyNeeds:
    from betterbench.policies.learned import is_seeing

    return AT_ONCE if is_seeing(address) else STATE


def _make(address: PolicyAddress) -> Policy:
    from betterbench.policies.learned import make_seeing

    return make_seeing(address)


def _make_for(address: PolicyAddress, scene: TrialScene, trial: PlannedTrial | None) -> PrivilegedPolicy:
    del trial
    from betterbench.policies.learned import make_learned

    ours = own_scene(address, scene)
    return make_learned(address, ours.condition.instruction.text, ours.seed)


def _describe(address: PolicyAddress) -> PolicyInfo | None:
    from betterbench.policies.learned import is_seeing, learned_info

    return None if is_seeing(address) else learned_info(address)


def _require_world(address: PolicyAddress, world: str) -> None:
    sees = _needs(address) is AT_ONCE
    raise needs_own_scenes(address, "was trained on images" if sees else "uses the privileged state", world)


LEARNED = register(
    PolicyKind(
        form=_FORM,
        shown="learned:CHECKPOINT",
        summary="A learner trained by better train.",
        needs=_needs,
        make=_make,
        make_for=_make_for,
        describe=_describe,
        compares=True,
        require_world=_require_world,
    )
)
