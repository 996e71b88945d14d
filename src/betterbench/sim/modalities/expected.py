"""Header that is expected in the modality file for one view of one trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from betterbench.errors import one_line
from betterbench.records.modalities.header import ViewHeader
from betterbench.records.modalities.spec import MODALITIES, Modality, ViewSpec
from betterbench.tasks import TrialId

_MOST = 120
"""Maximum number of characters that a message quotes from a header. Untrusted files may contain very long texts."""


@dataclass(frozen=True, slots=True)
class ExpectedFile:
    """Values that are required in the header of a modality file, given its trial and its view.

    Attributes:
        record_sha256: SHA-256 of the trial's record file.
        quality: Render preset of the color images, or None if it is unknown.
        renderer: Properties of the OpenGL implementation that rendered the files of the folder, or None before the
            first image.
    """

    trial: TrialId
    view: ViewSpec
    modalities: tuple[Modality, ...]
    record_sha256: str
    quality: str | None
    renderer: Mapping[str, str] | None

    def difference(self, header: ViewHeader) -> str | None:
        """Compare a header with the expected values. Return the first difference, or None if there is none.

        The returned text continues a sentence that begins with the name of the file.
        """
        trial = one_line(f"{header.task}/{header.condition}/{header.seed}", most=_MOST)
        wanted = tuple(name for name in MODALITIES if name in self.modalities)
        if (header.task, header.condition, header.seed) != (self.trial.task, self.trial.condition, self.trial.seed):
            return f"belongs to {trial}"
        if header.record_sha256 != self.record_sha256:
            return f"was rendered from a different record of the trial (by {one_line(header.policy, most=_MOST)})"
        if header.view != self.view:
            return f"shows a different view ({header.view.text})"
        if header.modalities != wanted:
            return f"contains {', '.join(header.modalities)} instead of {', '.join(wanted)}"
        if self.quality not in {None, header.quality}:
            return f"was rendered with the preset {one_line(header.quality, most=_MOST)} instead of {self.quality}"
        if self.renderer is not None and dict(header.renderer) != dict(self.renderer):
            return "was rendered with a different OpenGL"
        return None
