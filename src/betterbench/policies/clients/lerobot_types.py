"""LeRobot policy types and the additional Python packages that each type requires.

Sources: ``pyproject.toml`` and ``src/lerobot/policies/factory.py`` in LeRobot 0.4.4 and 0.6.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from betterbench.errors import InvalidInputError, MissingDependencyError, one_line
from betterbench.installation import package_command


@dataclass(frozen=True, slots=True)
class Needs:
    """Python modules that a policy type requires, and the LeRobot extra that installs them."""

    extra: str = ""
    modules: tuple[str, ...] = ()


_PI = Needs("pi", ("transformers", "scipy"))

POLICY_TYPES: Mapping[str, Needs] = {
    "act": Needs(),
    "vqbet": Needs(),
    "tdmpc": Needs(),
    "diffusion": Needs("diffusion", ("diffusers",)),
    "multi_task_dit": Needs("multi_task_dit", ("transformers", "diffusers")),
    "smolvla": Needs("smolvla", ("transformers", "num2words")),
    "pi0": _PI,
    "pi05": _PI,
    "pi0_fast": _PI,
    "groot": Needs("groot", ("transformers", "peft", "timm")),
    "xvla": Needs("xvla", ("transformers",)),
    "wall_x": Needs("wallx", ("transformers", "peft", "torchdiffeq", "qwen_vl_utils")),
    "molmoact2": Needs("molmoact2", ("transformers", "peft")),
    "eo1": Needs("eo1", ("transformers", "qwen_vl_utils")),
    "evo1": Needs("evo1", ("transformers",)),
    "fastwam": Needs("fastwam", ("transformers", "diffusers")),
    "vla_jepa": Needs("vla_jepa", ("transformers", "diffusers", "qwen_vl_utils")),
    "lingbot_va": Needs("lingbot_va", ("transformers", "diffusers", "accelerate")),
}
"""Requirements of each policy type. Not every LeRobot release supports all of these types."""

REWARD_MODELS = ("reward_classifier", "sarm", "robometer", "topreward")
"""LeRobot types that are registered as policies but predict rewards instead of actions."""


def require_type(kind: str, known: Collection[str], where: str) -> None:
    """Check that the installed LeRobot release can load a policy type.

    Call this function before reading the weights, so that an unsupported checkpoint is rejected immediately.

    Args:
        kind: Policy type in the configuration of the checkpoint.
        known: Policy types registered in the installed LeRobot, including plugins.
        where: Name of the checkpoint for error messages.

    Raises:
        InvalidInputError: If the type is unknown, or if it is a reward model instead of a policy.
        MissingDependencyError: If a required package is not installed. The message names the LeRobot extra that
            installs the package.
    """
    release = _release()
    if kind in REWARD_MODELS:
        raise InvalidInputError(
            where,
            f"the checkpoint type {kind} is a reward model, which does not return actions",
            "Use the checkpoint of a policy",
        )
    if kind not in known:
        listed = ", ".join(_with_extra(name) for name in sorted(set(known) - set(REWARD_MODELS)))
        raise InvalidInputError(
            where,
            f"the checkpoint type {one_line(kind, most=60)!r} is not known to LeRobot {release}",
            f"Install a release that supports this type, or use a checkpoint of one of these types: {listed}",
        )
    needs = POLICY_TYPES.get(kind, Needs())
    missing = [module for module in needs.modules if importlib.util.find_spec(module) is None]
    if missing:
        raise MissingDependencyError(
            f"{where} has the type {kind}, which needs {', '.join(missing)}. {_install(needs.extra, release)}"
        )


def _with_extra(kind: str) -> str:
    extra = POLICY_TYPES.get(kind, Needs()).extra
    return f"{kind} (lerobot[{extra}])" if extra else kind


def _install(extra: str, release: str) -> str:
    """Return a message that explains how to install a LeRobot extra, even if the installed release lacks the extra."""
    try:
        offered = importlib.metadata.metadata("lerobot").get_all("Provides-Extra") or []
    except importlib.metadata.PackageNotFoundError:
        offered = []
    if offered and extra not in offered:
        return (
            f"LeRobot {release} has no extra for this policy type. Install lerobot[{extra}] of LeRobot 0.6 on "
            "Python 3.12, or serve the checkpoint from such an environment with better serve "
            "lerobot:CHECKPOINT."
        )
    return f"Run: {package_command(f'lerobot[{extra}]')}"


def _release() -> str:
    try:
        return importlib.metadata.version("lerobot")
    except importlib.metadata.PackageNotFoundError:
        return "(unknown release)"
