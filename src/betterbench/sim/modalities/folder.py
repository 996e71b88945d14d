"""Modality folder: its settings, the files of each trial, and the list of semantic ids."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import TypeAdapter

from betterbench.errors import RecordError, RunConflictError
from betterbench.jobs import write_durably
from betterbench.jobs.conflict import first_difference, require_free, require_same
from betterbench.jobs.durable import PART_SUFFIX
from betterbench.json_form import NO_TRUTH, dump_json, open_seal, read_bounded, read_form, sealed_form, strict_form
from betterbench.ordinary_file import read_ordinary
from betterbench.records import RunFolder
from betterbench.records.modalities.labels import semantic_ids
from betterbench.records.modalities.spec import MODALITIES, Modality, ViewSpec, require_views
from betterbench.sim.assets import categories
from betterbench.sim.scenes.stage import quality_preset, require_cameras
from betterbench.tasks import TrialId

SETTINGS_VERSION: Literal[2] = 2
"""Version of the settings format. Since version 2, the settings contain a checksum."""
SETTINGS_FILE, SEMANTICS_FILE = "materialize.json", "semantics.json"
_MAX_BYTES = 1 << 20


@strict_form
@dataclass(frozen=True, slots=True)
class Wanted:
    """Settings of a modality folder: views, modalities and renderer. They are the same for all its trials.

    Attributes:
        quality: Render preset of the color images. None means the preset with which the policy of each record was run.
        renderer: Properties of OpenGL, or None until the first image is rendered. Different renderers give different
            pixels.
    """

    views: tuple[ViewSpec, ...]
    modalities: tuple[Modality, ...] = MODALITIES
    quality: str | None = None
    renderer: Mapping[str, str] | None = None
    format_version: Annotated[Literal[1, 2], NO_TRUTH] = SETTINGS_VERSION

    def __post_init__(self) -> None:
        """Reject views, cameras and presets that do not exist."""
        require_views(self.views)
        require_cameras(v.camera for v in self.views if v.placed is None)
        if self.quality is not None:
            quality_preset(self.quality)


_WANTED = TypeAdapter(Wanted)


class ModalityFolder:
    """Folder of modality files. Writing can be resumed with the same settings.

    Once the folder contains a modality file, different settings are rejected.

    Raises:
        RunConflictError: If the folder contains other modalities or unrelated files.
        RecordError: If the settings of the folder are damaged.
    """

    def __init__(self, path: Path, wanted: Wanted) -> None:
        self.path, self.wanted = path.absolute(), wanted
        settings = self.path / SETTINGS_FILE
        if settings.exists():
            stored = read_settings(self.path)
            if _is_begun(self.path):
                require_same_settings(self.path, stored, wanted)
                self.wanted = stored
            elif stored != wanted:
                # While the folder contains no files, its settings may still change. An earlier command may have ended
                # before its first image.
                write_durably(settings, _text(wanted))
        else:
            require_free_place(self.path)
            write_durably(settings, _text(wanted))
        ids = {"about": "Semantic id by category; 0 is nothing (the sky).", "ids": semantic_ids(categories())}
        text = json.dumps(ids, indent=1).encode() + b"\n"
        if not (self.path / SEMANTICS_FILE).exists() or read_ordinary(self.path / SEMANTICS_FILE) != text:
            write_durably(self.path / SEMANTICS_FILE, text)

    def trial(self, trial: TrialId) -> Path:
        """Return the folder of a trial's files. Raises InvalidInputError if a name would lead out of the folder."""
        return trial_folder(self.path, trial)

    def claim(self, renderer: Mapping[str, str]) -> None:
        """Store the properties of this process's OpenGL in the settings of the folder.

        Raises RunConflictError if earlier images were rendered with a different OpenGL.
        """
        if self.wanted.renderer is None:
            self.wanted = replace(self.wanted, renderer=dict(renderer))
            write_durably(self.path / SETTINGS_FILE, _text(self.wanted))
        difference = first_difference(dict(self.wanted.renderer or {}), dict(renderer), "renderer")
        if difference is not None:
            where, there, here = difference
            raise RunConflictError(
                f"{self.path}: the images were rendered with a different OpenGL. Its {where} is {there} in the folder "
                f"but {here} on this machine, so pixels may differ. Continue on the same kind of machine, or choose a "
                "different --out."
            )


def require_free_place(path: Path) -> None:
    """Raise RunConflictError if the folder contains files but no modality settings."""
    require_free(path, "set of modalities", file=SETTINGS_FILE, besides=(SEMANTICS_FILE,))


def trial_folder(path: Path, trial: TrialId) -> Path:
    """Return the folder of a trial in a modality folder.

    Raises InvalidInputError if a name would lead out of the folder.
    """
    record = RunFolder(path, {}, {}).record_path(trial.task, trial.condition, trial.seed)
    return path / trial.task / trial.condition / record.stem


def files_in(path: Path) -> list[Path]:
    """Return the files of all trials in a modality folder, sorted by name."""
    return sorted(path.glob("*/*/*/*.parquet"))


def _is_begun(path: Path) -> bool:
    """Return whether a modality folder contains a finished or unfinished file of any trial."""
    return any(any(path.glob(f"*/*/*/{name}")) for name in ("*.parquet", f".*{PART_SUFFIX}"))


def require_same_settings(path: Path, stored: Wanted, wanted: Wanted) -> None:
    """Raise RunConflictError if the stored settings of a folder differ from the requested settings."""
    require_same(path, _form(replace(stored, renderer=None)), _form(wanted), "set of modalities", where="materialize")


def read_settings(path: Path) -> Wanted:
    """Read the settings of a modality folder. Raises RecordError if they are missing or damaged."""
    cure = "Choose a folder that `better materialize` has written"
    data = read_bounded(path / SETTINGS_FILE, max_bytes=_MAX_BYTES, cure=cure, raises=RecordError)
    where = str(path / SETTINGS_FILE)
    form = open_seal(data, where=where, cure=cure, raises=RecordError, since=("format_version", 2))
    found = read_form(_WANTED, form, where=where, cure=cure, raises=RecordError)
    return replace(found, format_version=SETTINGS_VERSION)


def _form(wanted: Wanted) -> dict[str, object]:
    return dict(_WANTED.dump_python(wanted, mode="json"))


def _text(wanted: Wanted) -> bytes:
    return json.dumps(sealed_form(json.loads(dump_json(_form(wanted)))), indent=2).encode() + b"\n"
