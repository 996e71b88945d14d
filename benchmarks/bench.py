"""Measure the speed of betterbench as ratios within one run: ``make bench``, or ``python benchmarks/bench.py``.

The exit status is always 0, because this is a measurement and not a test. ``--only ROW`` (repeatable) measures some
rows, ``--quick`` repeats each measurement less often, and ``--json`` prints the figures as one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

# One thread per process on both sides, as the package sets it; must be set before numerical libraries are loaded.
for _name, _value in (("OMP_NUM_THREADS", "1"), ("LP_NUM_THREADS", "0")):
    os.environ.setdefault(_name, _value)

import numpy as np  # noqa: E402

import betterbench  # noqa: E402
from betterbench.errors import MissingDependencyError  # noqa: E402
from betterbench.sim.scenes import engine_version, renderer_fingerprint  # noqa: E402
from figures import Figure  # noqa: E402
from peer_rows import PeerRows  # noqa: E402
from rows import rows  # noqa: E402


def main() -> None:
    """Measure and print."""
    peer = PeerRows()
    known = rows(peer)
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n", maxsplit=1)[0])
    parser.add_argument("--only", action="append", choices=list(known), metavar="ROW", help=", ".join(known))
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    machine = describe_machine()
    figures: list[Figure] = []
    began = time.perf_counter()
    if not options.json:
        print(_head(machine))
    for name in options.only or known:
        try:
            for figure in known[name](quick=options.quick):
                figures.append(figure)
                if not options.json:
                    print(line_of(figure), flush=True)
        except MissingDependencyError as error:
            figures.append(Figure(name, "images", (), "x", note=str(error)))
            if not options.json:
                print(line_of(figures[-1]), flush=True)
    machine["peers"] = peer.versions()
    machine["load_at_end"] = _load()
    machine["took_s"] = round(time.perf_counter() - began, 1)
    if options.json:
        lines = [{**asdict(f), "median": f.median if f.values else None, "reached": f.reached} for f in figures]
        print(json.dumps({"machine": machine, "figures": lines}, indent=2))
    else:
        print(f"\n{machine['took_s']} s; load at the end {machine['load_at_end']}")
        for peer_name, versions in machine["peers"].items():
            print(f"peer {peer_name}: {', '.join(f'{k} {v}' for k, v in versions.items())}")


def describe_machine() -> dict[str, Any]:
    """Return the machine, settings and versions that influence the figures."""
    try:
        renderer = renderer_fingerprint()
    except MissingDependencyError as error:
        renderer = {"missing": str(error)}
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "usable_cores": len(os.sched_getaffinity(0)),
        "load": _load(),
        "system": platform.platform(),
        "threads": {name: os.environ.get(name, "") for name in ("OMP_NUM_THREADS", "LP_NUM_THREADS")},
        "renderer": renderer,
        "versions": {
            "betterbench": betterbench.__version__,
            "python": platform.python_version(),
            "mujoco": engine_version(),
            "numpy": np.__version__,
        },
    }


def line_of(figure: Figure) -> str:
    """Return one line of the table."""
    verdict = {True: "reached", False: "NOT reached", None: ""}[figure.reached]
    if figure.values:
        low, high = min(figure.values), max(figure.values)
        shown = f"{_number(figure.median)} {figure.unit}"
        spread = f"[{_number(low)}-{_number(high)}]" if len(figure.values) > 1 else ""
    else:
        shown, spread, verdict = "not measured", "", ""
    required = "" if figure.bound is None else f"{figure.relation} {figure.bound:g} {figure.unit}"
    line = f"{figure.row:<10} {figure.text:<55} {shown:>12} {spread:<13} {required:<11} {verdict:<11}"
    return f"{line.rstrip()}\n{'':<11}{figure.note}" if figure.note else line.rstrip()


def _head(machine: dict[str, Any]) -> str:
    renderer = ", ".join(str(v) for v in machine["renderer"].values())
    versions = ", ".join(f"{k} {v}" for k, v in machine["versions"].items())
    title = f"{'row':<10} {'what':<55} {'median':>12} {'[min-max]':<13} {'required':<11} verdict"
    return (
        f"{machine['processor']}, {machine['usable_cores']} of {machine['cores']} cores, load {machine['load']}\n"
        f"{renderer}\n{versions}\n\n{title}\n{'-' * len(title)}"
    )


def _number(value: float) -> str:
    """Return a number with three digits, without an exponent."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _processor() -> str:
    """Return the name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _load() -> str:
    """Return the load of the last minute, five and fifteen minutes."""
    return " ".join(f"{value:.2f}" for value in os.getloadavg())


if __name__ == "__main__":
    main()
