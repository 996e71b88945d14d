"""Modality files: images, depth, masks, boxes and flow of every recorded state, written while recording or later."""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.sim.modalities.folder import Wanted
    from betterbench.sim.modalities.live import LiveMaterializer

__all__ = ["LiveMaterializer", "Wanted"]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(__name__, {"folder": ("Wanted",), "live": ("LiveMaterializer",)})
