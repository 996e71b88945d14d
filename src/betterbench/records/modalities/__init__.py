"""Modality files: images, masks and boxes of recorded states, which can be read without a simulator."""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.records.modalities.file import ModalityFile
    from betterbench.records.modalities.spec import MODALITIES, ViewSpec

__all__ = ["MODALITIES", "ModalityFile", "ViewSpec"]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(__name__, {"file": ("ModalityFile",), "spec": ("MODALITIES", "ViewSpec")})
