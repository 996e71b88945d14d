"""Code shared by the policy kinds of built-in privileged policies: their names, options and creation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.errors import InvalidInputError, registering_place
from betterbench.interface import PolicyInfo
from betterbench.interface.actions import PLANNED_SPACES
from betterbench.policies.address import AddressForm, PolicyAddress
from betterbench.policies.kinds.kind import STATE, PlannedTrial, PolicyKind, register, unknown_policy

if TYPE_CHECKING:
    from betterbench.interface.state import PrivilegedPolicy
    from betterbench.sim.scenes import Scene
    from betterbench.sim.worlds import TrialScene


def register_privileged(form: AddressForm, summary: str) -> PolicyKind:
    """Register the privileged policies that have a certain address format as a policy kind."""

    def named() -> dict[str, str]:
        from betterbench.policies.experts.registry import EXPERTS, REPLAYS, expert_names

        summaries = {**{name: entry.summary for name, entry in EXPERTS.items()}, **REPLAYS}
        return {name: summaries[name] for name in expert_names(form)}

    def read(text: str, world: str) -> PolicyAddress:
        from betterbench.policies.experts.address import WITNESS

        address = form.read(text, world=world)
        if address.name not in (*named(), WITNESS):
            raise unknown_policy(text)
        return address

    return register(
        PolicyKind(
            form=form,
            shown=form.example,
            summary=summary,
            needs=STATE,
            named=named,
            read=read,
            make_for=_make,
            describe=describe_privileged,
            require_world=_require_world,
            spaces=PLANNED_SPACES,
        ),
        registering_place(),
    )


def describe_privileged(address: PolicyAddress) -> PolicyInfo:
    """Return the description of a policy that uses the simulator state and plans in the action space ``ee_delta``."""
    return PolicyInfo(address.text, action_space="ee_delta", needs_images=False)


def own_scene(address: PolicyAddress, scene: TrialScene) -> Scene:
    """Return the scene if it is one of betterbench's own scenes. Otherwise, raise InvalidInputError."""
    from betterbench.sim.scenes import Scene

    if not isinstance(scene, Scene):
        raise needs_own_scenes(address, "uses the privileged state", "this benchmark")
    return scene


def needs_own_scenes(address: PolicyAddress, needs: str, world: str, known: tuple[str, ...] = ()) -> InvalidInputError:
    """Create the error for a policy that cannot act in benchmarks other than betterbench.

    Args:
        address: Address of the policy.
        needs: Predicate of a sentence that says why the policy needs betterbench's scenes ("uses the privileged
            state").
        world: Name of the benchmark, as shown in messages.
        known: Policies that do work in this benchmark.
    """
    return InvalidInputError(
        "--policy",
        f"{address} {needs} of betterbench's own scenes, which {world} does not have",
        "Choose a policy that uses observations"
        + (f", or a policy that supports this world: {', '.join(known)}" if known else ""),
    )


def _make(address: PolicyAddress, scene: TrialScene, trial: PlannedTrial | None) -> PrivilegedPolicy:
    del trial
    from betterbench.policies.experts.in_worlds import EXPERTS_IN

    make = EXPERTS_IN.get(scene.world)
    if make is None:
        raise needs_own_scenes(address, "plans with the privileged state", "this benchmark")
    return make(address.text, scene)


def _require_world(address: PolicyAddress, world: str) -> None:
    from betterbench.policies.experts.in_worlds import POLICIES_IN

    known = POLICIES_IN.get(world, ())
    if address.name not in known:
        raise needs_own_scenes(address, "uses the privileged state", world, known)
