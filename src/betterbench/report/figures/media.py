"""Media of a report: film strips, initial images with paths, thumbnails, and commands that replay a trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from betterbench.quoting import shell_word
from betterbench.report.figures.film import Film


@dataclass(frozen=True, slots=True)
class Thumbnails:
    """Initial scenes of a variation and of the training trial with the same seed, as JPEG.

    ``training`` is None if the run has no such training trial.
    """

    test: bytes
    training: bytes | None = None


@dataclass(frozen=True, slots=True)
class Media:
    """Images and run folders for a report. Parts of the page that need missing images or folders are left out.

    Attributes:
        films: Film strips by :func:`~betterbench.report.figures.film.film_key`.
        paths: Images of the initial state with the path of the end effector (JPEG), by the same keys.
        thumbnails: Initial scenes by variation ("fast_food/T1").
        folders: Run folder of each policy as the user wrote it, for use in commands.
        options: Further options for these commands, such as " --task-file mine.py".
    """

    films: Mapping[str, Film] = field(default_factory=dict)
    paths: Mapping[str, bytes] = field(default_factory=dict)
    thumbnails: Mapping[str, Thumbnails] = field(default_factory=dict)
    folders: Mapping[str, str] = field(default_factory=dict)
    options: str = ""

    def replay_command(self, policy: str, record: str | None) -> str:
        """Return the command that renders a record ("records/fast_food/T1/0.parquet") as a video.

        Return "" if the record or the run folder is unknown.
        """
        start = self.replay_start(policy)
        return f"{start}{record} --twin{self.options}" if start and record is not None else ""

    def replay_start(self, policy: str) -> str:
        """Return the beginning of all commands that replay trials of a policy.

        Return "" if the run folder is unknown.
        """
        folder = self.folders.get(policy)
        return "" if folder is None else f"better replay {shell_word(folder.rstrip('/') + '/')}"


NO_MEDIA = Media()
"""Media of a report without images."""
