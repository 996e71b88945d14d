"""The statements on the benchmark: an unmeasured variation is never called safe from blind policies."""

from __future__ import annotations

import dataclasses

import pytest
from tests.diagnosis.small_matrix import matrix
from tests.report.factory import diagnosis, trial

from betterbench.diagnosis.measures.power_matrix import BLIND, FLOOR
from betterbench.report.pages import trust

SAFE = "No variation of this run is solved without images, instruction or aim more often than by chance."


@pytest.fixture
def told(monkeypatch):
    def told_with(found, variations):
        monkeypatch.setattr(trust, "power_matrix_of", lambda _tasks: found)
        return trust.trust_of([diagnosis([trial(variation=name) for name in variations])])["Blind probes"]

    return told_with


def without_probes():
    full = matrix()
    return dataclasses.replace(full, cells={n: row for n, row in full.cells.items() if n not in (*BLIND, *FLOOR)})


def test_a_measured_variation_is_safe(told):
    assert told(matrix(), ["L1"]) == SAFE


def test_a_matrix_of_faulty_policies_alone_says_nothing_about_blind_ones(told):
    """``better build --power`` tries no blind probe."""
    said = told(without_probes(), ["L1", "R1"])
    assert said == "Not measured on L1, R1 of fast_food; measure it again with better calibrate --power."


def test_what_is_missing_is_named_beside_what_was_measured(told):
    assert told(matrix(), ["L1", "T1"]) == (
        f"{SAFE} Not measured on T1 of fast_food; measure it again with better calibrate --power."
    )


def test_variations_in_which_nothing_is_to_be_done_need_no_probe(told, monkeypatch):
    monkeypatch.setattr(trust, "_requires_action", lambda _name: False)
    assert told(without_probes(), ["L1"]) == SAFE
