"""The extra `lerobot` installs what LeRobot's own evaluation needs, on every supported Python."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))


def installed(extra, python):
    """The requirements of an extra that apply to a version of Python."""
    found = [Requirement(text) for text in PROJECT["project"]["optional-dependencies"][extra]]
    return [r for r in found if r.marker is None or r.marker.evaluate({"python_version": python})]


@pytest.mark.parametrize("python", ["3.12", "3.13"])
def test_lerobot_from_python_312_on_comes_with_its_data_sets_and_diffusion(python):
    """LeRobot 0.6 moved both out of its core: `lerobot-eval` and diffusion policies ended with an ImportError."""
    (lerobot,) = installed("lerobot", python)
    assert {"dataset", "diffusion"} <= lerobot.extras
    assert "0.6.1" in lerobot.specifier
    assert "0.5.0" not in lerobot.specifier


def test_lerobot_for_python_311_has_both_in_its_core():
    (lerobot,) = installed("lerobot", "3.11")
    assert not lerobot.extras
    assert "0.4.4" in lerobot.specifier
