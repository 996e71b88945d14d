"""Modality files: images, masks and boxes of recorded states, readable without a simulator."""

from betterbench.records.modalities.file import ModalityFile
from betterbench.records.modalities.spec import MODALITIES, ViewSpec

__all__ = ["MODALITIES", "ModalityFile", "ViewSpec"]
