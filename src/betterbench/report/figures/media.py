"""Media of a report: films, initial images with paths, thumbnails, and commands that replay a trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from betterbench.quoting import shell_word
from betterbench.report.figures.film import Film


@dataclass(frozen=True, slots=True)
class Thumbnails:
    """The scenes of a variation and its training twin at reset (JPEG), or None if the run has no such scene."""

    test: bytes
    training: bytes | None = None


@dataclass(frozen=True, slots=True)
class Media:
    """Images and run folders by name. The page omits missing entries.

    Attributes:
        films: Films by :func:`~betterbench.report.figures.film.film_key`.
        paths: Images of the initial state with the end effector's path (JPEG), by the same keys.
        thumbnails: Scenes by variation ("fast_food/T1").
        folders: Run folder by policy, as given by the caller, for commands.
        options: Further options of these commands (" --task-file mine.py").
    """

    films: Mapping[str, Film] = field(default_factory=dict)
    paths: Mapping[str, bytes] = field(default_factory=dict)
    thumbnails: Mapping[str, Thumbnails] = field(default_factory=dict)
    folders: Mapping[str, str] = field(default_factory=dict)
    options: str = ""

    def replay_command(self, policy: str, record: str | None) -> str:
        """Return the command that writes the film of a record ("records/fast_food/T1/0.parquet"), or ""."""
        start = self.replay_start(policy)
        return f"{start}{record} --twin{self.options}" if start and record is not None else ""

    def replay_start(self, policy: str) -> str:
        """Return the beginning of commands that replay a policy's trials.

        The result is empty if its folder is unknown.
        """
        folder = self.folders.get(policy)
        return "" if folder is None else f"better replay {shell_word(folder.rstrip('/') + '/')}"


NO_MEDIA = Media()
"""Media of a report without images."""
