"""Our own demonstrations, exported in every preset of ``better export``, are read alike by the audit."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import pytest
from tests.daily import others_slow, part_of_today

from betterbench.cli.main import main
from betterbench.demonstrations.export import ExportPlan, export_dataset, job, layout_of, select_demonstrations
from betterbench.demonstrations.shortcuts.lerobot import read_lerobot
from betterbench.policies.conventions.presets import OWN_PRESETS
from betterbench.tasks import TrialId

sys.path.insert(0, str(Path(__file__).parents[1] / "export"))
from demonstrating import PaintedPictures, add_record, start_run

pytestmark = [pytest.mark.physics]


@pytest.fixture(scope="module")
def collected(sources, tmp_path_factory):
    """Two demonstrations of each training condition, which differ in their seed: just enough for an audit."""
    records = [
        dataclasses.replace(record, metadata=dataclasses.replace(record.metadata, seed=record.metadata.seed + more))
        for more in (0, 1)
        for record in sources.records()
    ]
    trials = [TrialId(r.metadata.task, r.metadata.condition, r.metadata.seed) for r in records]
    run = start_run(tmp_path_factory.mktemp("collected") / "run", trials, policy=records[0].metadata.policy)
    for record in records:
        add_record(run, record)
        run.store_scene(record.metadata.scene_hash, sources.load_scene(record.metadata.scene_hash))
    return run


def exported(run, out, name, form, most=None):
    """Exports without images, which the audit does not read and which take nearly all of the time."""
    layout = dataclasses.replace(layout_of(name), images=(), copies={})
    selection = select_demonstrations([run])
    selection = dataclasses.replace(selection, demonstrations=selection.demonstrations[:most])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(job, "Pictures", PaintedPictures)  # without a process that renders nothing
        export_dataset(ExportPlan([run], selection, layout=layout, to=form, out=out))
    return out


LAYOUTS = {
    str([layout.states, layout.action, layout.adapter.answer]): name
    for name, layout in ((name, layout_of(name)) for name in OWN_PRESETS)
    if layout.robot == "panda"
}
"""One preset for each layout that differs in what the audit reads."""


@pytest.mark.parametrize("form", part_of_today(["lerobot", "lerobot-v2.1"], 2))
def test_an_export_in_a_preset_is_read_alike(collected, tmp_path, form):
    """In one form and every third preset, others each day."""
    read_alike(collected, tmp_path, form, part_of_today([*LAYOUTS.values()], 3))


@pytest.mark.slow
@pytest.mark.parametrize("form", ["lerobot", "lerobot-v2.1"])
def test_an_export_in_every_preset_is_read_alike(collected, tmp_path, form):
    read_alike(collected, tmp_path, form, LAYOUTS.values())


def read_alike(collected, tmp_path, form, presets):
    counted = {}
    for name in ("native", *presets):
        read = read_lerobot(exported(collected, tmp_path / f"{form} {name} {len(counted)}", name, form, 2))
        assert (read.reading.episodes, read.reading.of) == (2, 2), name
        ((gripper,), (place,)) = read.reading.grippers, read.reading.places
        assert gripper.never == 0, name
        assert not read.reading.warnings, name
        counted[name] = ([f.instruction for f in read.facts], [len(f.steps) for f in read.facts], gripper.share_closed)
        assert counted[name] == counted["native"], name
        spaces = {"openpi_droid": "joints", "gr00t_oxe_droid": "joints"}
        wanted = "position" if layout_of(name).states else "steps"
        assert place.space == spaces.get(name, wanted), name


@pytest.mark.parametrize("name", others_slow(["openpi_droid", "starvla", "native"], 3))
def test_an_export_is_audited_by_the_command(collected, tmp_path, capsys, name):
    out = exported(collected, tmp_path / "set", name, "lerobot-v2.1")
    assert main(["shortcuts", str(out)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "Instruction: task in meta/tasks.jsonl" in told
    wanted = {"openpi_droid": "in joint space", "starvla": "added up from the start", "native": "better.ee_position"}
    assert told.startswith("Read: ")
    assert wanted[name] in told
