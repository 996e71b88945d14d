"""Words of a stranger's data set in the folder of a recipe: read as texts, and run by nothing."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from tests.daily import others_slow
from tests.looping import each

from betterbench.cli.main import main
from betterbench.demonstrations.recipes import recipe_of, setup_files, trainer_setup
from betterbench.errors import UNPRINTABLE, InvalidInputError

sys.path.insert(0, str(Path(__file__).parents[2] / "quoting"))
from hostile import CANARY, HOSTILE

FRAMEWORKS = {
    "openpi": ("openpi_libero", "v2.1"),
    "gr00t": ("gr00t_new_embodiment", "v2.1"),
    "being-h": ("being_h_libero", "v2.1"),
    "lerobot": ("lerobot", "v3.0"),
}
PROGRAMS = (
    *("better", "python", "uv", "torchrun", "accelerate", "lerobot-train", "lerobot-eval", "mkdir", "ln", "realpath"),
    *("cp", "ls", "which"),
)


def data_set(folder, framework, *, quality="standard", vectors=("state",), **others):
    preset, version = FRAMEWORKS[framework]
    source = {"layout": {"adapter": {"name": preset}, "vectors": {name: {} for name in vectors}}, "quality": quality}
    info = {"codebase_version": version, "total_frames": 100}
    stats = {name: {"q01": [0.0, 0.0], "q99": [0.0, 1.0]} for name in vectors}
    files = {"betterbench": source, "info": info, "stats": stats}
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    for name, form in files.items():
        (folder / "meta" / f"{name}.json").write_text(json.dumps(others.get(name, form)), encoding="utf-8")
    return folder


def stand_ins(folder: Path) -> Path:
    """Writes stand-ins for all programs, which write down the words that they are given."""
    programs = folder / "programs"
    programs.mkdir()
    for name in PROGRAMS:
        (programs / name).write_text(f'#!/usr/bin/bash\nprintf "%s\\0" {name} "$@" "" >> "$BOX/words"\n')
    (programs / "touch").write_text(f'#!/usr/bin/bash\n: > "$BOX/{CANARY}"\n')
    for program in programs.iterdir():
        program.chmod(0o755)
    (programs / "dirname").symlink_to("/usr/bin/dirname")
    return programs


def run_in_a_box(script: Path, box: Path, programs: Path) -> subprocess.CompletedProcess:
    box.mkdir()
    env = {"PATH": str(programs), "HF_LEROBOT_HOME": "/x", "BOX": str(box)}
    return subprocess.run(["/usr/bin/bash", str(script)], check=False, cwd=box, capture_output=True, env=env)


@each("framework", FRAMEWORKS)
@each("word", HOSTILE, name=lambda t: ascii(t[:24]))
def test_the_quality_is_one_of_ours(tmp_path, framework, word):
    data = data_set(tmp_path / "demos", framework, quality=word)
    with pytest.raises(InvalidInputError, match="quality"):
        trainer_setup(framework, recipe_of("better"), (str(data),))


@pytest.mark.parametrize("framework", others_slow(FRAMEWORKS, 4))
def test_commands_run_nothing_that_was_planted(tmp_path, framework):
    recipe = "libero" if framework == "openpi" else "better"
    names = tuple(dict.fromkeys(text[:200] for text in HOSTILE if not set("\ud800\udcff") & set(text)))
    words = [text for text in HOSTILE if len(text) < 200 and not set("\0\ud800") & set(text)]
    programs = stand_ins(tmp_path)
    for number, word in enumerate(words):
        parent = tmp_path / f"{number}" / (word.strip("/").replace("..", "_") or "x")
        data = data_set(parent / "demos", framework, vectors=names)
        if UNPRINTABLE.search(word) or "\n" in word or "\t" in word:
            with pytest.raises(InvalidInputError, match="not the path of a data set"):
                trainer_setup(framework, recipe_of(recipe), (str(data),))
            with pytest.raises(InvalidInputError, match=r"--weights: .* is not a path\."):
                trainer_setup(framework, recipe_of(recipe), ("demos",), weights=word)
            continue
        setup = trainer_setup(framework, recipe_of(recipe), (str(data),), weights=word or None)
        files = setup_files(setup, recipe_of(recipe))
        out = tmp_path / f"{number}" / "recipe"
        out.mkdir()
        for name, text in files.items():
            (out / name).write_bytes(text.encode())
        box = tmp_path / f"{number}" / "box"
        done = run_in_a_box(out / "commands.sh", box, programs)
        assert not (box / CANARY).exists(), word
        assert b"command not found" not in done.stderr
        said = (box / "words").read_bytes().decode()
        assert str(data) in said
        for name, text in files.items():
            if name.endswith(".py"):
                compile(text, name, "exec")
        assert not UNPRINTABLE.search(files["README.md"])
        table = [line for line in files["README.md"].splitlines() if line.startswith("|")]
        assert len(table) == 2 + len(setup.settings)


@pytest.mark.parametrize("framework", FRAMEWORKS)
def test_the_terminal_shows_what_was_planted_as_text(tmp_path, framework, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data_set(tmp_path / "demos", framework, vectors=tuple(t[:200] for t in HOSTILE if not UNPRINTABLE.search(t[-9:])))
    assert main(["recipe", framework, "--data", "demos", "--out", "made"]) == 0
    shown = "".join(capsys.readouterr())
    assert not UNPRINTABLE.search(shown)
    assert not (tmp_path / CANARY).exists()


FOREIGN = (None, True, 5, -1, 1.5, float("nan"), 10**400, "x", [], [[]], {}, {"a": {}})


@pytest.mark.parametrize("framework", ["gr00t", "lerobot"])
def test_meta_files_of_other_shapes_are_refused_in_one_line(tmp_path, framework, monkeypatch):
    sys.set_int_max_str_digits(0)
    deep = "[" * 100_000 + "]" * 100_000
    number = 0
    for name in ("betterbench", "info", "stats"):
        for value in FOREIGN:
            data = data_set(tmp_path / f"a{number}" / "demos", framework, **{name: value})
            number += 1
            with pytest.raises(InvalidInputError):
                trainer_setup(framework, recipe_of("better"), (str(data),))
        data = data_set(tmp_path / name / "demos", framework)
        for text in (deep, "{", "", "\0", '{"layout": 1, "layout": 2}'):
            (data / "meta" / f"{name}.json").write_text(text)
            with pytest.raises(InvalidInputError):
                trainer_setup(framework, recipe_of("better"), (str(data),))
    for value in FOREIGN:
        for field in ("codebase_version", "total_frames"):
            info = {"codebase_version": FRAMEWORKS[framework][1], "total_frames": 100} | {field: value}
            if (field, value) == ("total_frames", 5):
                continue
            data = data_set(tmp_path / f"b{number}" / "demos", framework, info=info)
            number += 1
            with pytest.raises(InvalidInputError):
                trainer_setup(framework, recipe_of("better"), (str(data),))
    sys.set_int_max_str_digits(4300)
