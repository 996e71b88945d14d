"""Mixtures of training data: the paper's mixture, draws with exact proportions, and training budgets."""

from betterbench_calibration.mixture.budget import Budget, TokenPrices, budget_of
from betterbench_calibration.mixture.pretraining import PaperMixture, PretrainingRun, paper_mixture
from betterbench_calibration.mixture.sampler import MixtureDraw, MixtureSampler
from betterbench_calibration.mixture.shares import MixturePart, WeightedGroup, Within, shares_of
from betterbench_calibration.mixture.sources import FileMixture, ItemSource, mixture_of_files

__all__ = [
    "Budget",
    "FileMixture",
    "ItemSource",
    "MixtureDraw",
    "MixturePart",
    "MixtureSampler",
    "PaperMixture",
    "PretrainingRun",
    "TokenPrices",
    "WeightedGroup",
    "Within",
    "budget_of",
    "mixture_of_files",
    "paper_mixture",
    "shares_of",
]
