"""The documentation's page of the packaged calibration, with the confusion matrix as a picture."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from betterbench.diagnosis import packaged_calibration
from betterbench.diagnosis.power_matrix import packaged_power_matrix
from betterbench.report.calibration_page import calibration_markdown, write_calibration_page
from betterbench.report.power_page import power_markdown

HEAD = """# Calibration

Calibration measures how often the diagnosis gives the true label. Every [faulty policy](diagnosis.md#faulty-policies)
decides by one wrong rule, at several strengths and with action noise. It records its own first wrong decision, and the
diagnosis, which reads only the records, has to find this fault.

```sh
better calibrate --out runs/calibration
```

computes these numbers again and writes a page that lists every wrong label with its evidence. It can be interrupted and
resumed; with `--tasks fast_food` it takes a few minutes. The table of policies names the strengths that were used for
the packaged numbers.

The matrix has one limit: the faulty policies were written together with the diagnosis, so they only have faults that
its authors thought of. A policy with another kind of fault gets the label whose evidence fits best; the report shows
the film beside it.

![confusion matrix](pictures/confusion.png)

"""

POWER = """
## The power matrix

A success rate proves only what policies without the ability do not reach. The power matrix holds what each of them
reaches on each variation: every faulty rule at full strength with the expert's motion, probes that get no instruction
or no images, demonstrations replayed without looking, a random policy and one that never moves. It ships with the
package; `better diagnose`, `better report` and `better compare` draw its reference lines beside a policy's score.

```sh
better calibrate --power --out runs/power
```

measures it again and writes a page; it can be interrupted and resumed. Replays play demonstrations, whose seeds begin
at 1,000,000, and never the trial's own twin. What is blind gets as many trials on each variation as Holm's correction
over all cells needs to flag one that it always solves: 7 where chance is a quarter, 14 where it is a half.

A faulty rule **fails** a variation if it solves at most half of its trials. A variation **claims to expose** a label if
some rule fails it by a decision with that label. A **control cell** is failed by no rule but `zoo:halt`, which stops at
everything new. The **shortcut ceiling** is the best success rate among the rules that a variation claims to expose, the
blind probes and the replays; the **margin** is a policy's success rate minus the ceiling.

"""
NOT_MEASURED = "This version of the suite has not been measured yet.\n"


def write(out: Path) -> None:
    """Write ``calibration.md`` and its picture below the folder of the documentation."""
    found = packaged_calibration()
    if found is None:
        raise SystemExit("no packaged calibration; run better calibrate --write-package")
    with tempfile.TemporaryDirectory() as folder:
        write_calibration_page(found, Path(folder))
        shutil.copy(Path(folder) / "confusion.png", out / "pictures" / "confusion.png")
    power = packaged_power_matrix()
    text = HEAD + calibration_markdown(found) + POWER + (NOT_MEASURED if power is None else power_markdown(power))
    (out / "calibration.md").write_text(text, encoding="utf-8")
