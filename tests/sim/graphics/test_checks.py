"""Variables that choose an OpenGL that is not there: the cause is named wherever an image is wanted."""

import json
import os
import subprocess
import sys

import pytest
from tests.daily import others_slow

from betterbench.errors import GraphicsError, MissingDependencyError
from betterbench.sim.graphics import back_ends, checks, gl_backend

NAMES = ("MUJOCO_GL", "MUJOCO_EGL_DEVICE_ID", "PYOPENGL_PLATFORM", "DISPLAY", "WAYLAND_DISPLAY")


@pytest.fixture
def clean(monkeypatch):
    for name in (*NAMES, "BETTERBENCH_EGL_DEVICES"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(checks, "has_library", lambda name: name == "egl")
    monkeypatch.setattr(back_ends, "has_library", lambda name: name == "egl")
    return monkeypatch


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"MUJOCO_GL": "foo"}, "MUJOCO_GL: 'foo' is not a supported OpenGL back end (known: egl, osmesa, glfw)."),
        ({"MUJOCO_GL": "off"}, "MUJOCO_GL: 'off' disables rendering. Unset it, or set it to egl."),
        ({"MUJOCO_GL": "glfw"}, "MUJOCO_GL: 'glfw' needs a window, but DISPLAY does not name a display."),
        ({"PYOPENGL_PLATFORM": "osmesa"}, "images are rendered with 'egl', the back end found here. Unset it"),
        ({"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "glx"}, "rendered with 'egl', from MUJOCO_GL. Unset it"),
        ({"MUJOCO_GL": "osmesa"}, "its library cannot be loaded. Unset it, to use 'egl', or run: apt-get"),
    ],
)  # fmt: skip
def test_the_variable_is_named_with_its_cure(clean, variables, said):
    for name, value in variables.items():
        clean.setenv(name, value)
    with pytest.raises(MissingDependencyError) as caught:
        checks.require_drawing()
    assert said in str(caught.value)
    assert isinstance(caught.value, GraphicsError) == ("apt-get" not in str(caught.value))


@pytest.mark.parametrize("value", ["egl", "EGL", " egl ", "", "1", "glx"])
def test_what_mujoco_takes_is_taken(clean, value):
    clean.setenv("MUJOCO_GL", value)
    clean.setenv("PYOPENGL_PLATFORM", "EGL")
    checks.require_engine()
    assert gl_backend() == "egl"


def test_a_machine_without_opengl_is_told_what_to_install(clean):
    for module in (checks, back_ends):
        clean.setattr(module, "has_library", lambda _: False)
    with pytest.raises(MissingDependencyError, match=r"neither EGL nor OSMesa can be loaded .*libegl1"):
        checks.require_drawing()
    clean.setenv("MUJOCO_GL", "egl")
    with pytest.raises(MissingDependencyError, match=r"its library cannot be loaded\. Run: apt"):
        checks.require_engine()


@pytest.mark.skipif(gl_backend() != "egl", reason="EGL is not installed")
@pytest.mark.parametrize(
    ("verb", "name", "value"),
    others_slow(
        [
            ("doctor", "MUJOCO_EGL_DEVICE_ID", "77"),
            ("doctor", "PYOPENGL_PLATFORM", "osmesa"),
            ("doctor --json", "MUJOCO_EGL_DEVICE_ID", "first"),
            ("doctor --json", "MUJOCO_GL", "foo"),
            ("show fast_food --out {out}", "MUJOCO_EGL_DEVICE_ID", "77"),
            ("show fast_food --out {out}", "MUJOCO_GL", "foo"),
        ],
        6,
    ),
)
def test_every_verb_that_draws_names_the_variable_and_no_package(tmp_path, name, value, verb):
    environment = {k: v for k, v in os.environ.items() if k not in NAMES} | {"MUJOCO_GL": "egl", name: value}
    words = verb.format(out=tmp_path / "x.png").split()
    done = subprocess.run(
        [sys.executable, "-m", "betterbench.cli", *words], env=environment, check=False, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    said = done.stdout + done.stderr
    assert f"{name}: " in said
    assert "Unset it, or set it to" in said
    assert "apt-get" not in said
    if "--json" in verb:
        broken = [check for check in json.loads(done.stdout) if not check["works"]]
        assert broken
        assert all(check["cure"].startswith(name) for check in broken)
