"""Static evaluation of vision-language models: published benchmarks and our own question sets.

- ``items``: items of a benchmark with pictures on demand; ``pictures`` reads pictures from files and tables.
- ``benchmarks``: one file per benchmark, which reads every published form of its data; ``rows`` reads their rows.
- ``prompts``: prompts as data, chosen by an identifier.
- ``scoring``, ``official``: our scores with fixed denominators, and the scores of upstream programs, faults included.
- ``models``: resolutions of pictures, and models in the process.
- ``running``: a resumable run of a model over a benchmark; ``fetching`` downloads the data.

Answers are asked for and read by :mod:`betterbench.vqa`, as for ``better vqa``.
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
