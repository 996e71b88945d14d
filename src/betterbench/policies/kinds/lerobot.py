"""Policy kind ``lerobot``: LeRobot checkpoints, which run in a separate process.

LeRobot's own server is not supported.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.policies.address import CAMERA, AddressForm, Option, PolicyAddress
from betterbench.policies.kinds.kind import OWN_PROCESS, SERVER, PolicyKind, register
from betterbench.policies.kinds.remote import COMMON, require_own_layout, space_in_world

if TYPE_CHECKING:
    from betterbench.errors import InvalidInputError
    from betterbench.interface import Policy

_FORM = AddressForm(
    scheme="lerobot",
    example="lerobot:CHECKPOINT",
    options=(
        *COMMON,
        Option("device", "the device on which the network runs"),
        Option("state", "the state used in training: ee, joints or motors"),
        Option("trust", "whether code that the checkpoint refers to is run: true or false"),
        CAMERA,
    ),
)
_SERVER_FORM = AddressForm(scheme="grpc", example="lerobot:CHECKPOINT", target="optional")


def _read(text: str, world: str) -> PolicyAddress:
    if text.startswith(f"{_FORM.scheme}://"):
        raise _pickles(text)
    return _FORM.read(text, world=world)


def _refuse(text: str, world: str) -> PolicyAddress:
    del world
    raise _pickles(text)


def _pickles(text: str) -> InvalidInputError:
    return PolicyAddress(text, _SERVER_FORM, "").error(
        "LeRobot's policy server (lerobot.async_inference, gRPC) pickles observations and actions. Unpickling an "
        "untrusted answer can run arbitrary code, so betterbench does not support it",
        "Write lerobot:CHECKPOINT, which loads the same checkpoint locally, or run better serve lerobot:CHECKPOINT "
        "where the server runs, and connect with openpi://",
    )


def _make(address: PolicyAddress) -> Policy:
    from betterbench.policies.clients.lerobot import load_lerobot

    return load_lerobot(address)


LEROBOT = register(
    PolicyKind(
        form=_FORM,
        shown="lerobot:CHECKPOINT",
        summary="A policy of LeRobot, in a separate process.",
        needs=OWN_PROCESS,
        make=_make,
        read=_read,
        compares=True,
        risk="loads the checkpoint {target}, which can run code",
        require_world=require_own_layout,
        space_in_world=space_in_world,
    )
)
LEROBOT_SERVER = register(
    PolicyKind(form=_SERVER_FORM, shown="grpc://HOST:PORT", summary="", needs=SERVER, read=_refuse)
)
