"""The real LeRobot and the real robomimic read what we write, in environments of their own."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from betterbench.demonstrations.export import ExportPlan, export_dataset, layout_of, select_demonstrations
from betterbench.demonstrations.export.frames import frame_numbers

sys.path.insert(0, str(Path(__file__).parents[2] / "policies"))
from torch_environment import NoTorchError, run_in_torch

pytestmark = [pytest.mark.slow, pytest.mark.render, pytest.mark.physics]

HERE = Path(__file__).parent


def exported(demonstrations, out: Path, to: str, preset: str, **options) -> None:
    runs = [demonstrations.run]
    export_dataset(ExportPlan(runs, select_demonstrations(runs), layout_of(preset), to, out, **options))


@pytest.mark.parametrize(("form", "most_error"), [("png", 0.0), ("video", 4.0)])
def test_lerobot_loads_the_data_set(demonstrations, tmp_path, form, most_error):
    exported(demonstrations, tmp_path / form, "lerobot", "lerobot", form=form)
    expected(demonstrations, tmp_path / f"{form}.npz", most_error)
    assert "18 frames" in in_lerobot("read", tmp_path, form)


def test_newer_lerobot_reads_the_language_columns(demonstrations, tmp_path):
    found = in_lerobot("version", tmp_path, "set").split(".")
    if (int(found[0]), int(found[1])) < (0, 6):
        pytest.skip("LeRobot 0.4 refuses data sets with language columns")
    exported(demonstrations, tmp_path / "set", "lerobot", "lerobot", form="png", language=True)
    expected(demonstrations, tmp_path / "set.npz", 0.0)
    assert "18 frames" in in_lerobot("read", tmp_path, "set")


def test_lerobot_trains_act_for_twenty_steps(demonstrations, tmp_path):
    exported(demonstrations, tmp_path / "set", "lerobot", "lerobot")
    assert "adapter is the preset lerobot" in in_lerobot("train", tmp_path, "set")


@pytest.mark.skipif(importlib.util.find_spec("h5py") is None, reason="needs h5py (extra robomimic)")
def test_robomimic_reads_the_file(demonstrations, tmp_path):
    path, wanted = tmp_path / "set.hdf5", tmp_path / "set.npz"
    exported(demonstrations, path, "robomimic", "native")
    np.savez(
        wanted,
        actions=np.concatenate([r.applied[1:] for r in demonstrations.records.values()]),
        joint_positions=np.concatenate([r.joint_positions[:-1] for r in demonstrations.records.values()]),
        front=np.array([seen.images["front"] for kept in demonstrations.seen.values() for seen in kept]),
    )
    assert "robomimic 0.3.0: 18 frames" in driven("robomimic_drive.py", str(path), str(wanted))


def in_lerobot(what: str, folder: Path, name: str) -> str:
    return driven("lerobot_drive.py", what, str(folder), name)


def driven(script: str, *arguments: str) -> str:
    try:
        done = run_in_torch(str(HERE / script), *arguments, timeout_s=1800.0)
    except NoTorchError as error:
        pytest.skip(str(error))
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


def expected(demonstrations, path: Path, most_error: float) -> None:
    """Writes what each frame holds, from the adapter's requests and from the records."""
    layout = layout_of("lerobot")
    seen = [observation for kept in demonstrations.seen.values() for observation in kept]
    records = list(demonstrations.records.values())
    requests = [layout.adapter.request(observation) for observation in seen]
    columns = {key: np.array([request[key] for request in requests]) for key in requests[0]}
    actions = np.concatenate([record.applied[1:] for record in records]).astype(np.float32)
    subgoals = [name for record in records for name in frame_numbers(record, layout).subgoals]
    rows = np.arange(0, len(seen), 4)
    np.savez(path, **columns, action=actions, subgoal=np.array(subgoals), rows=rows, most_error=most_error)
