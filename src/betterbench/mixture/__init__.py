"""Mixtures of training data: the paper's as data, draws that follow weights exactly, and what a budget buys."""

from betterbench.mixture.budget import Budget, TokenPrices, budget_of
from betterbench.mixture.pretraining import PaperMixture, PretrainingRun, paper_mixture
from betterbench.mixture.sampler import MixtureDraw, MixtureSampler
from betterbench.mixture.shares import MixturePart, Within, shares_of
from betterbench.mixture.sources import FileMixture, ItemSource, mixture_of_files

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
    "Within",
    "budget_of",
    "mixture_of_files",
    "paper_mixture",
    "shares_of",
]
