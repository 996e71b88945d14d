"""Export sample logs in the format of lmms-eval, for tools that read this format.

The format is that of ``save_results_samples`` in ``loggers/evaluation_tracker.py`` of lmms-eval (commit 75571cf). A
file ``MODEL/DATE_samples_TASK.jsonl`` has one line per sample, without the document. ``resps`` is omitted if it equals
``filtered_resps``. The metric is betterbench's score. lmms-eval itself would give different scores for the same
replies, because its parsers differ (:mod:`betterbench.vlm.official`).
"""

from __future__ import annotations

import hashlib
import json
import re
from datetime import datetime
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError, RecordError
from betterbench.jobs import write_durably
from betterbench.vlm.running import ANSWERS_NAME
from betterbench.vlm.stored import StoredItem, StoredRun, is_static_run, read_static_run
from betterbench.vqa.asking import ModelAnswer, read_stored_answers

TASKS = {"better-vqa": "better_vqa", "embspatial": "embspatial", "refspatial": "refspatial", "egoplan2": "egoplan2"}
"""Name of the task for each benchmark. lmms-eval has no task for our own question sets."""
METRIC = "betterbench_score"


def write_samples(path: Path, out: Path, *, overwrite: bool = False) -> tuple[Path, int]:
    """Write the sample log of a finished run. Return the path of the file and the number of samples.

    Args:
        path: Folder of a run of ``better vlm``.
        out: Folder for the logs. Each model gets a folder inside it.
        overwrite: Whether to replace an existing file.

    Raises:
        InvalidInputError: If the folder was not written by ``better vlm --out``, or the file already exists.
        RecordError: If the run is not finished, was changed, or was written by an earlier version.
    """
    if not is_static_run(path):
        raise InvalidInputError(
            str(path), "it is not the output folder of better vlm", "Pass a folder written by better vlm --out"
        )
    run = read_static_run(path)
    texts = read_stored_answers(path / ANSWERS_NAME).answers
    date = datetime.fromisoformat(str(run.head["begun"])).strftime("%Y%m%d_%H%M%S")
    task = TASKS[run.benchmark.name]
    model = re.sub(r"[\"<>:/|\\?*\[\]]+", "__", str(run.head["model"]))
    file = out / model / f"{date}_samples_{task}.jsonl"
    if file.exists() and not overwrite:
        raise InvalidInputError(str(file), "it already exists", "Use --overwrite or a different --out")
    lines = [_sample(run, number, item, texts.get(item.id)) for number, item in enumerate(run.items.values())]
    file.parent.mkdir(parents=True, exist_ok=True)
    write_durably(file, "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines).encode())
    return file, len(lines)


def _sample(run: StoredRun, number: int, item: StoredItem, answer: ModelAnswer | None) -> dict[str, Any]:
    if item.prompt is None or item.target is None:
        cure = "Run better vlm again with the same options; answered items are not asked again"
        raise RecordError(f"{run.path} was written by an earlier version, without prompts. {cure}.")
    document = {"benchmark": run.benchmark.name, "data": run.head["data"], "id": item.id}
    return {
        "doc_id": number,
        "target": item.target,
        "filtered_resps": "" if answer is None else answer.text,
        "token_counts": [None],
        "doc_hash": hashlib.sha256(json.dumps(document, indent=2).encode()).hexdigest(),
        METRIC: float(item.score_in("extracted")),
        "input": item.prompt,
        "betterbench": {
            "id": item.id,
            "value": item.value,
            "stage": item.stage,
            "score": item.score,
            "error": None if answer is None else answer.error,
            "groups": item.groups,
            "cluster": item.cluster,
        },
    }
