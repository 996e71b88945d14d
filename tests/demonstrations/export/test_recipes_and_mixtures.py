"""What better export writes is what recipes check and mixtures draw from."""

from __future__ import annotations

import pyarrow.parquet as pq
import pytest

from betterbench.demonstrations.export import ExportPlan, export_dataset, layout_of, select_demonstrations
from betterbench.demonstrations.recipes import recipe_of, trainer_setup
from betterbench.errors import InvalidInputError
from betterbench_calibration.mixture.sources import open_source

pytestmark = [pytest.mark.render, pytest.mark.physics]

FRAMEWORKS = {
    "openpi": "openpi_libero",
    "gr00t": "gr00t_new_embodiment",
    "being-h": "being_h_libero",
    "lerobot": "lerobot",
}


@pytest.mark.parametrize("framework", FRAMEWORKS)
def test_each_framework_takes_its_export_and_no_other(demonstrations, painted, tmp_path, framework):
    to = "lerobot" if framework == "lerobot" else "lerobot-v2.1"
    runs, out = [demonstrations.run], tmp_path / "set"
    plan = ExportPlan(runs, select_demonstrations(runs), layout_of(FRAMEWORKS[framework]), to, out, validation=0.5)
    export_dataset(plan)
    setup = trainer_setup(framework, recipe_of(), (str(out),), gpus=1)
    frames = sum(record.n_steps for record in demonstrations.records.values())
    assert f"passes over the {frames} frames" in setup.checks[0]
    assert "--quality fast" in setup.evaluation
    for other in FRAMEWORKS.keys() - {framework}:
        with pytest.raises(InvalidInputError, match="better export"):
            trainer_setup(other, recipe_of(), (str(out),), gpus=1)
    source = open_source(out)
    tables = [pq.read_table(file) for file in sorted((out / "data").rglob("*.parquet"))]
    rows = [
        {"episode": row["episode_index"], "frame": row["frame_index"], "index": row["index"]}
        for table in tables
        for row in table.select(["episode_index", "frame_index", "index"]).to_pylist()
    ]
    assert [source.item(i) for i in range(len(source))] == rows[: len(source)]
    assert 0 < len(source) < len(rows)  # episodes for validation are not drawn
