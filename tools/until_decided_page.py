"""Compute the tables about ``--until-decided``: false alarms for honest policies, and the saved trials.

Run with ``python tools/until_decided_page.py``; it takes about three minutes and writes the tables into the page of the
documentation. ``--runs`` reads the faulty policies' outcome table again, from runs that contain training trials.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from betterbench.evaluation import make_plan
from betterbench.records import RunFolder
from betterbench.statistics import (
    PairedTable,
    Question,
    StoppingRule,
    Verdict,
    decide,
    holm,
    mcnemar_p,
    newcombe_paired_difference,
)
from betterbench.tasks import suite_tasks

PAGE = Path("docs/until-decided.md")
TABLE = Path(__file__).with_name("until_decided_outcomes.json")
MOST = 20
"""Trials per variation of the fixed design, and their maximum in the sequential design."""
STRENGTHS = (1.0, 0.6, 0.3)
"""Fractions of trials in which a faulty policy's rule applies, as in the calibration."""
REPEATS = 20
"""Runs of each faulty policy at each strength."""
RULE = StoppingRule()

Rates = Mapping[str, float]
Counts = dict[str, dict[str, tuple[int, int]]]


@dataclass(frozen=True, slots=True)
class Suite:
    """The suite's variations and their twins; ``planned`` is the number of trials in a plain ``better eval``."""

    questions: tuple[Question, ...]
    planned: int

    @property
    def conditions(self) -> tuple[str, ...]:
        """Every variation, and every training condition that is a twin."""
        return tuple(dict.fromkeys(name for q in self.questions for name in (q.condition, q.twin)))


def whole_suite() -> Suite:
    """Return all variations of better60."""
    plan = make_plan("expert", tasks=suite_tasks("better60"), trials=MOST, until_decided=True)
    twins = {f"{t.task}/{t.condition}": f"{t.task}/{t.base_condition}" for t in plan.trials if t.variation is not None}
    planned = len(make_plan("expert", tasks=suite_tasks("better60"), trials=MOST).trials)
    return Suite(tuple(Question(condition, twin) for condition, twin in twins.items()), planned)


@dataclass(frozen=True, slots=True)
class Simulated:
    """One run: all outcomes by condition, and the verdicts and number of trials with ``--until-decided``."""

    outcomes: Mapping[str, Sequence[bool]]
    verdicts: Mapping[str, Verdict]
    trials: int


def simulate(suite: Suite, rates: Rates, generator: np.random.Generator, *, most: int = MOST) -> Simulated:
    """Return one run of a policy with known success rates; all trials are independent."""
    draws = generator.random((len(suite.conditions), most))
    outcomes = {name: (row < rates[name]).tolist() for name, row in zip(suite.conditions, draws, strict=True)}
    found = decide(suite.questions, range(most), lambda name, seed: outcomes[name][seed], rule=RULE)
    used: Counter[str] = Counter()
    for answer in found.answers:
        used[answer.question.condition] = answer.pairs
        used[answer.question.twin] = max(used[answer.question.twin], answer.pairs)
    return Simulated(outcomes, {a.question.condition: a.verdict for a in found.answers}, used.total())


# ------------------------------------------------------------------------------------------------- honest policies


def alarm_rows(suite: Suite, suites: int) -> Iterator[list[str]]:
    """Yield the rates of wrong verdicts on policies with a known verdict, over a number of simulated suites."""
    honest = [(rate, rate) for rate in (1.0, 0.95, 0.8, 0.5, 0.2, 0.05)]
    halved = [(1.0, 0.5), (0.75, 0.25), (0.5, 0.0)]
    for number, (twin, varied) in enumerate((*honest, *halved)):
        rates = {q.condition: varied for q in suite.questions} | {q.twin: twin for q in suite.questions}
        generator = np.random.default_rng([60, number])
        wrong = (Verdict.DROP,) if twin == varied else (Verdict.NO_DROP, Verdict.NOT_LEARNED)
        alarms = alone = decided = trials = 0
        for _ in range(suites):
            run = simulate(suite, rates, generator)
            counts = Counter(run.verdicts.values())
            mistaken = sum(counts[verdict] for verdict in wrong)
            alarms += mistaken > 0
            alone += mistaken
            decided += len(run.verdicts) - counts[Verdict.OPEN]
            trials += run.trials
        n = suites * len(suite.questions)
        yield [
            f"{100 * twin:.0f} %",
            f"{100 * varied:.0f} %",
            "drop" if twin == varied else "no drop",
            f"{100 * alarms / suites:.1f} %",
            f"{100 * alone / n:.2f} %",
            f"{100 * decided / n:.0f} %",
            f"{trials / suites:,.0f}",
        ]


def mixed_rows(suite: Suite, suites: int) -> Iterator[list[str]]:
    """Yield the share of wrong verdicts on policies that drop in some variations, averaged over simulated suites."""
    for number, (share, kept, lost) in enumerate([(0.1, 0.95, 0.05), (0.5, 0.95, 0.05), (0.2, 0.8, 0.3)]):
        generator = np.random.default_rng([61, number])
        dropping = round(share * len(suite.questions))
        totals: dict[str, float] = defaultdict(float)
        for _ in range(suites):
            chosen = set(generator.choice(len(suite.questions), dropping, replace=False).tolist())
            rates = {q.twin: kept for q in suite.questions}
            rates |= {q.condition: lost if i in chosen else kept for i, q in enumerate(suite.questions)}
            run = simulate(suite, rates, generator)
            truth = {q.condition: i in chosen for i, q in enumerate(suite.questions)}
            said = [truth[name] for name, verdict in run.verdicts.items() if verdict is Verdict.DROP]
            denied = [truth[n] for n, v in run.verdicts.items() if v in (Verdict.NO_DROP, Verdict.NOT_LEARNED)]
            totals["drop"] += said.count(False) / max(1, len(said))
            totals["no drop"] += denied.count(True) / max(1, len(denied)) if kept - lost >= RULE.margin else 0.0
            totals["found"] += said.count(True) / dropping
            totals["trials"] += run.trials
        yield [
            f"{dropping} of {len(suite.questions)}",
            f"{100 * kept:.0f} % to {100 * lost:.0f} %",
            f"{100 * totals['drop'] / suites:.2f} %",
            f"{100 * totals['no drop'] / suites:.2f} %",
            f"{100 * totals['found'] / suites:.0f} %",
            f"{totals['trials'] / suites:,.0f}",
        ]


# ------------------------------------------------------------------------------------------------- faulty policies


def fixed_verdicts(suite: Suite, outcomes: Mapping[str, Sequence[bool]]) -> dict[str, Verdict]:
    """Return the verdicts of the fixed design, with the same number of trials for all variations.

    A drop is shown by McNemar's exact test, corrected by Holm as in a report; its absence by Newcombe's interval.
    """
    tables = {
        q.condition: PairedTable.from_outcomes(zip(outcomes[q.twin], outcomes[q.condition], strict=True))
        for q in suite.questions
    }
    corrected = holm([_p(t.both, t.only_first, t.only_second, t.neither) for t in tables.values()])
    found = {}
    for (name, table), p in zip(tables.items(), corrected, strict=True):
        if p <= RULE.level and table.only_first > table.only_second:
            found[name] = Verdict.DROP
        elif _high(table.both, table.only_first, table.only_second, table.neither) < RULE.margin:
            learned = 2 * (table.both + table.only_first) >= table.n
            found[name] = Verdict.NO_DROP if learned else Verdict.NOT_LEARNED
        else:
            found[name] = Verdict.OPEN
    return found


@cache
def _p(*counts: int) -> float:
    return mcnemar_p(PairedTable(*counts))


@cache
def _high(*counts: int) -> float:
    return newcombe_paired_difference(PairedTable(*counts)).high


@dataclass(slots=True)
class Tally:
    """Sums over runs: verdicts of the two designs, wrong verdicts, and trials."""

    runs: int = 0
    verdicts: int = 0
    same: int = 0
    opposite: int = 0
    only_fixed: int = 0
    only_sequential: int = 0
    wrong: int = 0
    wrong_fixed: int = 0
    trials: int = 0

    def add(self, suite: Suite, rates: Rates, run: Simulated) -> None:
        """Compare one run with the fixed design on the same trials."""
        fixed = fixed_verdicts(suite, run.outcomes)
        self.runs += 1
        self.trials += run.trials
        for q in suite.questions:
            now, then = run.verdicts[q.condition], fixed[q.condition]
            drop = rates[q.twin] - rates[q.condition]
            self.verdicts += 1
            self.same += now is then
            self.only_fixed += now is Verdict.OPEN is not then
            self.only_sequential += then is Verdict.OPEN is not now
            self.opposite += Verdict.OPEN not in (now, then) and (now is Verdict.DROP) is not (then is Verdict.DROP)
            self.wrong += _is_wrong(now, drop)
            self.wrong_fixed += _is_wrong(then, drop)

    def row(self, name: str, suite: Suite) -> list[str]:
        """Return the row of the table."""
        fixed = MOST * len(suite.conditions)
        mean = self.trials / self.runs
        shares = (self.same, self.opposite, self.only_fixed, self.only_sequential, self.wrong, self.wrong_fixed)
        return [
            name,
            f"{mean:,.0f}",
            f"{fixed / mean:.1f}",
            f"{suite.planned / mean:.1f}",
            *(f"{100 * share / self.verdicts:.1f} %" for share in shares),
        ]


def _is_wrong(verdict: Verdict, drop: float) -> bool:
    if verdict is Verdict.DROP:
        return drop <= 1e-9
    return verdict is not Verdict.OPEN and drop >= RULE.margin - 1e-9


def policy_rows(suite: Suite, table: Counts) -> Iterator[list[str]]:
    """Yield both designs side by side: per strength over all policies, then per policy at full strength."""
    expert = {name: k / n for name, (k, n) in table["expert"].items()}
    faulty = {policy: {c: k / n for c, (k, n) in row.items()} for policy, row in table.items() if policy != "expert"}
    tallies: dict[str, Tally] = defaultdict(Tally)
    for number, (policy, rates) in enumerate(faulty.items()):
        for strength in STRENGTHS:
            mixed = {c: strength * rates[c] + (1.0 - strength) * expert[c] for c in suite.conditions}
            generator = np.random.default_rng([62, number, round(10 * strength)])
            for _ in range(REPEATS):
                run = simulate(suite, mixed, generator)
                tallies[f"all, strength {strength:g}"].add(suite, mixed, run)
                tallies["all, the three together"].add(suite, mixed, run)
                if strength == 1.0:
                    tallies[f"`{policy}`"].add(suite, mixed, run)
    for name in sorted(tallies, key=lambda n: (n.startswith("`"), n)):
        yield tallies[name].row(name, suite)


def read_runs(folders: Sequence[Path], suite: Suite) -> Counts:
    """Return the numbers of recorded and successful trials by policy and condition.

    Several runs may be of one policy. Policies without a trial of each condition are left out.
    """
    table: Counts = defaultdict(dict)
    for folder in folders:
        run = RunFolder.open(folder)
        counts = table[str(run.plan["policy"])]
        for entry in run.entries():
            if entry.status == "done":
                name = f"{entry.task}/{entry.condition}"
                k, n = counts.get(name, (0, 0))
                counts[name] = k + run.succeeded(entry.key), n + 1
    found: Counts = {}
    for policy, counts in table.items():
        missing = [name for name in suite.conditions if name not in counts]
        if missing:
            sys.stderr.write(f"{policy} is left out: it has no trial of {missing[0]}\n")
            continue
        found[policy] = {name: counts[name] for name in suite.conditions}
    return found


# ------------------------------------------------------------------------------------------------------- the page


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table."""
    lines = [columns, ["---", *["---:"] * (len(columns) - 1)], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def fill(text: str, name: str, block: str) -> str:
    """Return a page whose block of a name is replaced."""
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if begin not in text or end not in text:
        raise SystemExit(f"{PAGE} has no block {name!r}")
    replaced: Callable[[re.Match[str]], str] = lambda _: f"{begin}\n\n{block}\n{end}"  # noqa: E731
    return re.sub(f"{re.escape(begin)}.*?{re.escape(end)}", replaced, text, flags=re.DOTALL)


def main() -> None:
    """Write the tables into the page."""
    parser = argparse.ArgumentParser(description="Write the figures of runs until decided into the documentation.")
    parser.add_argument("--suites", type=int, default=2000, help="simulated suites of each honest policy")
    parser.add_argument("--runs", type=Path, nargs="*", default=(), help="runs to read the outcome table from")
    arguments = parser.parse_args()
    suite = whole_suite()
    if arguments.runs:
        TABLE.write_text(json.dumps(read_runs(arguments.runs, suite), indent=0) + "\n", encoding="utf-8")
    table: Counts = json.loads(TABLE.read_text(encoding="utf-8"))
    alarms = markdown(
        ("success rate of the twin", "success rate of the variation", "wrong verdict", "suites with a wrong verdict",
         "variations with a wrong verdict", "decided variations", "trials"),
        list(alarm_rows(suite, arguments.suites)),
    )  # fmt: skip
    mixed = markdown(
        ("variations that drop", "their success rate", "wrong verdicts `drop`", "wrong verdicts `no drop`",
         "drops that were found", "trials"),
        list(mixed_rows(suite, arguments.suites // 4)),
    )  # fmt: skip
    policies = markdown(
        ("policies", "trials", f"factor saved against {MOST} pairs", "factor saved against a plain run",
         "same verdict", "opposite verdict", f"decided only with {MOST} pairs", "decided only by `--until-decided`",
         "wrong verdicts of `--until-decided`", f"wrong verdicts with {MOST} pairs"),
        list(policy_rows(suite, table)),
    )  # fmt: skip
    text = PAGE.read_text(encoding="utf-8")
    for name, block in (("alarms", alarms), ("mixed", mixed), ("policies", policies)):
        text = fill(text, name, block)
    PAGE.write_text(text, encoding="utf-8")
    sys.stdout.write(f"wrote {PAGE}\n")


if __name__ == "__main__":
    main()
