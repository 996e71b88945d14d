"""Across worlds: the paper's Table 4 from runs, pairs of policies on the same initial states, and illusion gaps."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from betterbench.cli.main import main
from betterbench.comparison.across import LIBERO_COLUMNS, SuiteRun, gaps_of, read_suite_runs, world_table
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.records import RunFolder
from betterbench.sim.worlds.installation import start_code
from betterbench.statistics import Rate, mean_of_rates
from betterbench.tasks.worlds.calvin import ChainResult, SubtaskResult, calvin_chains

sys.path.insert(0, str(Path(__file__).parents[1] / "sim/worlds"))


def libero(policy: str, suite: str, rate: float, *, seed: int = 0, states: int = 50, protocol: str = "openpi"):
    draw = np.random.default_rng([seed, len(suite)])
    base, _, change = suite.partition("_swap")
    keys = [(f"{base}-{i:02d}", state) for i in range(10) for state in range(states)]
    outcomes = dict(zip(keys, (draw.random(len(keys)) < rate).tolist(), strict=True))
    name = "swap" if suite.endswith("_swap") else None
    del change
    return SuiteRun(policy, Path(f"{policy}-{suite}"), suite, base, name, protocol, {"mujoco": "3.3.7"}, outcomes)


def calvin(policy: str, lengths, *, suite: str = "calvin"):
    chains = tuple(
        ChainResult(
            c.number,
            tuple(SubtaskResult(name, i < n, 9) for i, name in enumerate(c.names[: min(5, n + 1)])),
        )
        for c, n in zip(calvin_chains(), lengths, strict=False)
    )
    change = None if suite == "calvin" else "resampled"
    return SuiteRun(policy, Path(f"{policy}-{suite}"), suite, "calvin", change, "calvin", {}, {}, chains)


def test_the_averages_are_those_of_the_paper_s_table():
    """Every row of the paper whose cells are counts of 500: the mean of its cells is the printed average."""
    rates = [Rate(k, 500) for k in (494, 491, 490, 462)]
    mean = mean_of_rates(rates)
    assert round(100 * mean.value, 2) == 96.85
    assert mean.low < mean.value < mean.high
    pooled = Rate(sum(r.k for r in rates), 2000)
    assert mean.high - mean.low == pytest.approx(pooled.high - pooled.low, rel=0.15)
    assert mean_of_rates([Rate(0, 0), *rates]).value is None
    with pytest.raises(InvalidInputError, match="rates"):
        mean_of_rates([])


def test_a_row_needs_all_four_suites_for_its_average():
    runs = [libero("a", suite, 0.9) for suite in LIBERO_COLUMNS]
    table = world_table(runs)
    (row,) = table.rows
    assert row.average.value == pytest.approx(np.mean([r.value for r in row.suites.values()]))
    assert table.notes == ()
    (short,) = world_table(runs[:3]).rows
    assert short.average is None
    assert len(short.suites) == 3


def test_policies_are_tested_on_the_same_initial_states():
    runs = [libero(p, s, rate, seed=i) for i, (p, rate) in enumerate((("a", 0.95), ("b", 0.8))) for s in LIBERO_COLUMNS]
    table = world_table(runs)
    assert [c.suite for c in table.contrasts] == [*LIBERO_COLUMNS, "average"]
    assert [c.pairs for c in table.contrasts] == [500] * 4 + [2000]
    for c in table.contrasts:
        assert c.p_value < 0.001
        assert c.difference.low > 0.0
    turned = world_table([*runs[4:], *runs[:4]])
    for c, d in zip(table.contrasts, turned.contrasts, strict=True):
        assert c.difference.value == pytest.approx(-d.difference.value)
        assert c.p_value == d.p_value
    same = world_table([*runs[:4], *(libero("c", s, 0.95, seed=0) for s in LIBERO_COLUMNS)])
    assert all(c.p_value == 1.0 and c.difference.value == 0.0 for c in same.contrasts)


def test_fewer_shared_states_are_fewer_pairs():
    table = world_table([libero("a", "libero_object", 0.9), libero("b", "libero_object", 0.9, states=20)])
    assert [c.pairs for c in table.contrasts] == [200]
    assert "b in libero_object: 200 of 500 trials of the protocol." in table.notes


def test_protocols_are_not_mixed():
    runs = [libero("a", "libero_object", 0.9), libero("b", "libero_object", 0.9, protocol="gr00t")]
    with pytest.raises(RunConflictError, match=r"protocol differ.*openpi.*gr00t.*--allow-mixed"):
        world_table(runs)
    assert any("protocol differ" in note for note in world_table(runs, allow_mixed=True).notes)


def test_chains_are_five_rates_and_a_length():
    draw = np.random.default_rng(3)
    good, bad = draw.integers(2, 6, 1000), draw.integers(0, 4, 1000)
    table = world_table([calvin("a", good), calvin("b", bad)])
    first, second = table.rows
    assert [r.k for r in first.chains.in_a_row] == [int((good >= k).sum()) for k in range(1, 6)]
    assert first.chains.length.value == pytest.approx(good.mean())
    assert second.chains.length.value == pytest.approx(sum(r.value for r in second.chains.in_a_row))
    ((a, b, told),) = table.chain_contrasts
    assert (a, b, told.chains) == ("a", "b", 1000)
    assert 5 * told.difference.value == pytest.approx(good.mean() - bad.mean())
    assert max(told.p_values) < 0.01
    assert (
        "a in calvin: 10 of 1,000 chains; CALVIN's published numbers use all of them."
        in world_table([calvin("a", good[:10])]).notes
    )


def test_a_gap_is_what_a_changed_scene_costs():
    runs = [
        libero("a", "libero_object", 0.9),
        libero("a", "libero_object_swap", 0.3),
        libero("b", "libero_object", 0.5),
        libero("b", "libero_object_swap", 0.5, seed=9),
        calvin("a", [4] * 1000),
        calvin("a", [3] * 500 + [2] * 500, suite="calvin_resampled"),
        libero("c", "libero_goal_swap", 0.5),
    ]
    gaps = gaps_of(runs)
    assert [(g.policy, g.world, g.change) for g in gaps] == [
        ("a", "LIBERO-PRO", "swap"),
        ("b", "LIBERO-PRO", "swap"),
        ("a", "CALVIN", "resampled"),
    ]
    lost, none, chains = gaps
    assert lost.difference.low > 0.5
    assert lost.difference.value == pytest.approx(lost.base - lost.changed)
    assert lost.p_value < 1e-6
    assert none.difference.low < 0.0 < none.difference.high
    assert 5 * chains.difference.value == pytest.approx(1.5)
    assert chains.p_value is None


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A policy in LIBERO, LIBERO-PRO and both suites of CALVIN, each in a world without physics."""
    tmp_path = tmp_path_factory.mktemp("worlds")
    from test_calvin import policy_text

    from betterbench.evaluation import evaluate
    from betterbench.evaluation.planning.world_plan import make_world_plan

    fake = _command("fake_world")
    chains = (*_command("fake_calvin"), str(tmp_path), "", "")
    shove = tmp_path / "shove.py"
    shove.write_text(
        "import numpy as np\nfrom betterbench.interface import PolicyInfo\n"
        "class Reads:\n    info = PolicyInfo('shove')\n    def reset(self, start): pass\n"
        "    def act(self, seen): return np.array([0.5, 0, 0, 0, 0, 0, 1.0])\n"
    )
    reads = tmp_path / "reads.py"
    reads.write_text(policy_text())
    made = []
    for suite in ("libero_object", "libero_object_swap"):
        plan = make_world_plan(f"python:{shove}:Reads", suite=suite, tasks=["3"], trials=2, command=fake)
        made.append(evaluate(plan, tmp_path / suite, workers=1, envs=1))
    for suite in ("calvin", "calvin_resampled"):
        plan = make_world_plan(f"python:{reads}:Reads", suite=suite, trials=2, command=chains)
        made.append(evaluate(plan, tmp_path / suite, workers=1, envs=1))
    return made


def _command(module: str) -> tuple[str, ...]:
    folder = str(Path(__file__).parents[1] / "sim/worlds")
    return (sys.executable, "-c", f"import sys; sys.path.append({folder!r})\n{start_code(module)}")


def test_runs_of_all_worlds_are_put_side_by_side(runs, tmp_path, capsys):
    paths = [str(run.path) for run in runs]
    names = [word for _ in runs for word in ("--name", "mine")]
    main(["compare", *paths, *names, "--out", str(tmp_path / "tables"), "--json"])
    said = json.loads(capsys.readouterr().out)
    (row,) = said["rows"]
    assert row["suites"]["libero_object"]["k"] == row["suites"]["libero_object"]["n"] == 2
    assert [rate["k"] for rate in row["calvin"]["in_a_row"]] == [2] * 5
    assert row["calvin"]["length"]["value"] == 5.0
    assert [(g["world"], g["change"]) for g in said["gaps"]] == [("LIBERO-PRO", "swap"), ("CALVIN", "resampled")]
    table = (tmp_path / "tables" / "table4.csv").read_text().splitlines()
    assert table[0].startswith("policy,libero_spatial_k")
    assert table[1].startswith("mine,,,,,,2,2,100,")
    main(["compare", *paths, *names])
    out = capsys.readouterr().out
    assert "5.000" in out
    assert "illusion gaps" in out
    read = read_suite_runs(runs[2:3], names=["mine"])
    assert [s.steps for s in read[0].chains[0].played] == [2] * 5
    with pytest.raises(InvalidInputError, match="are both runs of mine in calvin"):
        read_suite_runs([runs[2], runs[2]], names=["mine", "mine"])


def test_a_run_that_is_not_finished_keeps_its_denominator(runs, tmp_path):
    run = RunFolder.open(Path(shutil.copytree(runs[2].path, tmp_path / "calvin")))
    lines = run.journal_path.read_text().splitlines(keepends=True)
    run.journal_path.write_text("".join(line for line in lines if '"seed": 1' not in line and '"seed":1' not in line))
    (read,) = read_suite_runs([run], names=["mine"])
    assert read.unfinished == 1
    table = world_table([read])
    assert [rate.n for rate in table.rows[0].chains.in_a_row] == [2] * 5
    assert [rate.k for rate in table.rows[0].chains.in_a_row] == [1] * 5
    assert any("1/2 trials of mine in calvin are not finished" in note for note in table.notes)
