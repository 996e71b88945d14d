"""The documentation's page of the packaged calibration, with the confusion matrix as a picture."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from betterbench.diagnosis import packaged_calibration
from betterbench.report.calibration_page import calibration_markdown, write_calibration_page

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


def write(out: Path) -> None:
    """Write ``calibration.md`` and its picture below the folder of the documentation."""
    found = packaged_calibration()
    if found is None:
        raise SystemExit("no packaged calibration; run better calibrate --write-package")
    with tempfile.TemporaryDirectory() as folder:
        write_calibration_page(found, Path(folder))
        shutil.copy(Path(folder) / "confusion.png", out / "pictures" / "confusion.png")
    (out / "calibration.md").write_text(HEAD + calibration_markdown(found), encoding="utf-8")
