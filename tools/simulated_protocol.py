"""Write the folder of a real-robot protocol from simulated trials, recorded as a real arm would record them.

For each policy, a run of the SO-101 has the trials of all cells. Joint states get the noise of the encoders, films are
rendered from the front camera, and two judges enter the outcomes of a perfect judge, with occasional mistakes. With the
folder, ``better real judge`` and ``better real report`` can be tried, and labels without privileged state can be
compared with the simulated diagnosis.

Example:
    python tools/simulated_protocol.py runs/real --run expert=runs/expert --run zoo:phase=runs/phase
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from betterbench.diagnosis import TrialDiagnosis, diagnose_run
from betterbench.evaluation import write_video
from betterbench.jobs.decisions import now
from betterbench.real.outcomes import OUTCOMES
from betterbench.real.plan import PlannedTrial, RealPolicy, make_plan, write_plan
from betterbench.real.record import Film, RealJournal, TrialHeader, enter, write_attempt
from betterbench.records import Record, RunFolder, read_record
from joint_signals import judge_of, samples_of

RATE_HZ = 20.0


def film_of(run: RunFolder, trial: TrialDiagnosis, record: Record, size: int) -> tuple[Film, bytes]:
    """Return the film of the front camera."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "front.mp4"
        condition = trial.variation or trial.condition
        write_video(run, trial.task, condition, trial.seed, camera="front", size=size, out=out)
        return Film(size, size, len(record.time)), out.read_bytes()


def record_one(
    journal: RealJournal, planned: PlannedTrial, run: RunFolder, trial: TrialDiagnosis, *, size: int, noise: int
) -> str:
    """Write one trial, and return the outcome that a perfect judge would enter."""
    record = read_record(run.path / str(trial.record))
    samples = samples_of(record, noise=noise)
    films = {"front": film_of(run, trial, record, size)} if size else {}
    folder = journal.begin(planned.code)
    header = TrialHeader(
        1,
        planned.code,
        journal.state(planned.code).attempt,
        "simulated",
        trial.instruction,
        "degrees",
        RATE_HZ,
        now(),
        "time_limit",
        len(samples),
        0,
        0,
        0,
        {camera: film for camera, (film, _) in films.items()},
        {},
    )
    write_attempt(folder, header, samples, {camera: data for camera, (_, data) in films.items()})
    journal.end(planned.code, "time_limit")
    return judge_of(record, trial)


def main() -> None:
    """Write the folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--run", action="append", required=True, metavar="POLICY=RUN")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--conditions", nargs="+", help="default: one for each cell")
    parser.add_argument("--slips", type=float, default=0.1, help="share of the second judge's entries that are wrong")
    parser.add_argument("--films", type=int, default=0, metavar="PIXELS", help="side of the films; 0 for no films")
    parser.add_argument("--judges", type=int, default=2, help="number of judges, 0 to 2")
    given = parser.parse_args()
    runs = {address: RunFolder.open(Path(path)) for address, path in (pair.split("=", 1) for pair in given.run)}
    policies = [RealPolicy(address.replace("zoo:", ""), address) for address in runs]
    plan = make_plan(policies, repeats=given.repeats, conditions=given.conditions)
    write_plan(given.out, plan)
    trials: dict[tuple[str, str], list[TrialDiagnosis]] = {}
    for address, run in runs.items():
        for trial in diagnose_run(run).trials:
            if trial.record is not None:
                trials.setdefault((address, trial.variation or trial.condition), []).append(trial)
    rng, seen = np.random.default_rng(0), dict[str, str]()
    with RealJournal(given.out) as journal:
        for number, planned in enumerate(plan.trials):
            address = plan.address(planned.policy)
            trial = trials[address, planned.condition][planned.block]
            seen[planned.code] = record_one(journal, planned, runs[address], trial, size=given.films, noise=number)
            print(f"{number + 1} of {len(plan.trials)}: {trial.key} as {planned.code}", flush=True)
    others = [outcome.name for outcome in OUTCOMES if outcome.name not in ("other", "invalid")]
    for judge, slips in (("ada", 0.0), ("ben", given.slips))[: given.judges]:
        for code, outcome in seen.items():
            entered = others[int(rng.integers(len(others)))] if rng.random() < slips else outcome
            note = "no definition fits" if entered == "other" else ""
            enter(given.out, code, 1, author=judge, role="judge", outcome=entered, note=note)


if __name__ == "__main__":
    main()
