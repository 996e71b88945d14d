"""Text encoders and their registry.

Each encoder is one file, and new files in this folder are registered automatically. ``wordpiece`` splits texts into the
word pieces that the default encoder takes as input.
"""

import importlib
import pkgutil

from betterbench.sim.assets.catalogue.encoders.encoder import (
    DEFAULT,
    ENCODERS,
    EncoderKind,
    KnowsWords,
    TextEncoder,
    open_encoder,
    register,
)

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["DEFAULT", "ENCODERS", "EncoderKind", "KnowsWords", "TextEncoder", "open_encoder", "register"]
