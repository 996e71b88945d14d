"""The documentation's page of the packaged calibration, with the confusion matrix as a picture."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from betterbench.diagnosis import packaged_calibration
from betterbench.report.calibration_page import calibration_markdown, write_calibration_page

HEAD = """# Calibration

Calibration measures how often the diagnosis gives the true label. Every [faulty policy](diagnosis.md#faulty-policies)
decides by one broken rule, at several strengths and with action noise. It writes down its own first wrong decision,
and the diagnosis, which reads the records alone, has to find that fault.

```sh
better calibrate --out runs/calibration
```

makes these numbers again, with a page that lists every mistake beside its evidence. It can be interrupted and
resumed; with `--tasks fast_food` it takes a few minutes. The table of policies names the strengths that the packaged
numbers come from.

What the matrix cannot say: the faulty policies were written together with the diagnosis, so they hold the faults that
its authors thought of. A policy with a fault of another kind gets the label whose evidence comes closest, with its
film beside it.

![confusion matrix](pictures/confusion.png)

"""


def write(out: Path) -> None:
    """Write ``calibration.md`` and its picture below the folder of the documentation."""
    found = packaged_calibration()
    if found is None:
        raise SystemExit("no packaged calibration; run better calibrate --write-package")
    with tempfile.TemporaryDirectory() as folder:
        write_calibration_page(found, Path(folder))
        shutil.copy(Path(folder) / "confusion.png", out / "pictures" / "confusion.png")
    (out / "calibration.md").write_text(HEAD + calibration_markdown(found), encoding="utf-8")
