"""Compact data about trials for the page. Each string is stored once, and each trial is an array."""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Mapping, Sequence
from typing import Any

from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.errors import printable
from betterbench.quoting import LONGEST_TEXT
from betterbench.report.figures.film import film_key
from betterbench.report.figures.media import NO_MEDIA, Media
from betterbench.report.legend import AXIS_NAMES, families_of, modes_of


class StringTable:
    """Table of strings, in which each string is stored once and has an index. The index −1 stands for None."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self._numbers: dict[str, int] = {}

    def __getitem__(self, text: str | None) -> int:
        """Return the index of a string. A string that is not in the table is added."""
        if text is None:
            return -1
        text = printable(text, most=LONGEST_TEXT)
        if text not in self._numbers:
            self._numbers[text] = len(self.texts)
            self.texts.append(text)
        return self._numbers[text]


def listing_of(diagnoses: Sequence[RunDiagnosis], films: Mapping[str, int], media: Media = NO_MEDIA) -> dict[str, Any]:
    """Return the data for the list of trials. The file page.js names the columns of a trial.

    Args:
        diagnoses: Diagnoses of the runs.
        films: Index of each film strip on the page, by key.
        media: Images and run folders.
    """
    strings = StringTable()
    trials = [_row(d.policy, t, strings, films) for d in diagnoses for t in d.trials]
    return {
        "labels": {e.label.value: [e.name, e.family, e.definition] for e in modes_of(diagnoses)},
        "kinds": families_of(diagnoses),
        "axes": AXIS_NAMES,
        "strings": strings.texts,
        "trials": trials,
        "replay": {printable(d.policy, most=LONGEST_TEXT): media.replay_start(d.policy) for d in diagnoses},
        "options": media.options,
        "paths": {key: b64encode(image).decode("ascii") for key, image in media.paths.items()},
    }


def _row(policy: str, trial: TrialDiagnosis, strings: StringTable, films: Mapping[str, int]) -> list[Any]:
    """Return the columns of a trial in the order that page.js expects."""
    evidence = trial.evidence
    attempts = [
        [_s(a.start_s), _s(a.end_s), strings[a.object], strings[a.slot], strings[a.result], int(a.secured)]
        for a in trial.attempts
    ]
    return [
        strings[policy],
        strings[trial.task],
        strings[trial.variation],
        strings[trial.condition],
        strings[trial.axis],
        trial.seed,
        strings[trial.instruction],
        int(trial.success),
        strings[trial.expected],
        strings[trial.label.value],
        strings[trial.first_attempt],
        strings[trial.first_slot],
        strings[trial.intended],
        None if trial.intention_correct is None else int(trial.intention_correct),
        _s(trial.progress),
        attempts,
        strings[evidence.rule],
        strings[evidence.text],
        _s(evidence.start_s),
        _s(evidence.end_s),
        [strings[o] for o in evidence.objects],
        [strings[s] for s in evidence.shared],
        [strings[c] for c in evidence.candidates],
        trial.steps,
        _s(trial.duration_s),
        strings[trial.record],
        films.get(film_key(policy, trial.key), -1),
        [strings[e.text] for e in trial.needless],
        [_s(e.start_s) for e in trial.needless],
    ]


def _s(value: float) -> float | None:
    """Round a number to three digits. Return None if it is not finite."""
    return round(value, 3) if math.isfinite(value) else None
