"""Expected header of a modality file, for one view of one trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from betterbench.errors import one_line
from betterbench.records.modalities.header import ViewHeader
from betterbench.records.modalities.spec import MODALITIES, Modality, ViewSpec
from betterbench.tasks import TrialId

_MOST = 120
"""Most characters of a header's value in a message: files may come from a stranger."""


@dataclass(frozen=True, slots=True)
class ExpectedFile:
    """Values that the header of a modality file must have, for one view of one trial.

    Attributes:
        record_sha256: SHA-256 of the file of the trial's record.
        quality: Render preset of the colors, or None where it is not known.
        renderer: Fingerprint of the OpenGL that drew the folder, or None as long as none did.
    """

    trial: TrialId
    view: ViewSpec
    modalities: tuple[Modality, ...]
    record_sha256: str
    quality: str | None
    renderer: Mapping[str, str] | None

    def difference(self, header: ViewHeader) -> str | None:
        """Return the first difference of a header, as the rest of a sentence about its file, or None."""
        trial = one_line(f"{header.task}/{header.condition}/{header.seed}", most=_MOST)
        wanted = tuple(name for name in MODALITIES if name in self.modalities)
        if (header.task, header.condition, header.seed) != (self.trial.task, self.trial.condition, self.trial.seed):
            return f"is of {trial}"
        if header.record_sha256 != self.record_sha256:
            return f"was drawn of another record of the trial (by {one_line(header.policy, most=_MOST)})"
        if header.view != self.view:
            return f"shows another view ({header.view.text})"
        if header.modalities != wanted:
            return f"holds {', '.join(header.modalities)} instead of {', '.join(wanted)}"
        if self.quality not in {None, header.quality}:
            return f"was drawn by the preset {one_line(header.quality, most=_MOST)} instead of {self.quality}"
        if self.renderer is not None and dict(header.renderer) != dict(self.renderer):
            return "was drawn by another OpenGL"
        return None
