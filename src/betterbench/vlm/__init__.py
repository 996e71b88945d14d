"""Static evaluation of vision-language models on published benchmarks, and on question sets made from recorded trials.

- ``items``: the items of a benchmark, whose images are loaded on demand. ``pictures`` reads images from files and
  tables.
- ``benchmarks``: one file per benchmark, which reads its data in all published formats. ``rows`` reads the files.
- ``prompts``: prompts, stored as data and chosen by an identifier.
- ``scoring``: scores over all items, including items without an answer. ``official``: reproductions of the scorers
  of the benchmarks' authors and of other programs, including their faults.
- ``models``: image resolutions, and models that run in this process.
- ``running``: a run of a model over a benchmark, which can be resumed. ``fetching`` downloads the data.
- ``steps``: comparison of finished runs (``stored``). ``eyesight``: the smallest object size that a model can
  recognize.
- ``samples``: logs in the format of lmms-eval. ``inspect_tasks``: tasks for inspect_ai.

The requests are sent and the answers are read by the package :mod:`betterbench.vqa`, which ``better vqa`` also uses.
"""

from betterbench.vlm.benchmarks import BENCHMARKS, Benchmark, find_benchmark
from betterbench.vlm.items import Item, ItemSet
from betterbench.vlm.prompts import Prompt, find_prompt, prompts_of
from betterbench.vlm.running import RunSettings, StaticRun, evaluate_model
from betterbench.vlm.scoring import StaticScore, score_answers

__all__ = [
    "BENCHMARKS",
    "Benchmark",
    "Item",
    "ItemSet",
    "Prompt",
    "RunSettings",
    "StaticRun",
    "StaticScore",
    "evaluate_model",
    "find_benchmark",
    "find_prompt",
    "prompts_of",
    "score_answers",
]
