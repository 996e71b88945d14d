"""Statistics for small numbers of trials: intervals, exact tests, corrections for multiple testing, and power.

Functions raise an ``InvalidInputError`` that names the argument if counts are impossible or if a level, fraction or
probability is out of range. Confidence levels and alpha are two-sided and strictly between 0 and 1.
"""

from betterbench.statistics.agreement import AgreementTable
from betterbench.statistics.betting import anytime_interval, evidence_above, evidence_below
from betterbench.statistics.bootstrap import paired_bootstrap, wider_paired_difference
from betterbench.statistics.chance import chance_p, guessing_p
from betterbench.statistics.clustered import ClusteredMean, clustered_mean
from betterbench.statistics.difference import (
    Difference,
    delta_success_rate,
    mean_of_rates,
    newcombe_difference,
    newcombe_paired_difference,
)
from betterbench.statistics.flips import sign_flip_p
from betterbench.statistics.interval import Interval, IntervalMethod, clopper_pearson_interval, wilson_interval
from betterbench.statistics.letters import compact_letters
from betterbench.statistics.multiplicity import e_benjamini_hochberg, holm
from betterbench.statistics.paired import PairedTable, exchange_p, mcnemar_p
from betterbench.statistics.power import (
    DetectableDifference,
    paired_power,
    smallest_paired_difference,
    smallest_unpaired_difference,
    unpaired_power,
)
from betterbench.statistics.ranking import RankCorrelation, RankingArea, rank_correlation, ranking_area
from betterbench.statistics.rate import Rate
from betterbench.statistics.ratio import difference_of, ratio_of
from betterbench.statistics.rounding import percent, round_half_up
from betterbench.statistics.sequential import EProcess, discordant_e_process, two_rate_e_process
from betterbench.statistics.threshold import FurtherLoss, Reading, Threshold, fit_threshold
from betterbench.statistics.unpaired import barnard_p, barnard_p_values, boschloo_p, fisher_p
from betterbench.statistics.until_decided import (
    Answer,
    Decisions,
    Outcomes,
    Question,
    StoppingRule,
    Verdict,
    decide,
)

__all__ = [
    "AgreementTable",
    "Answer",
    "ClusteredMean",
    "Decisions",
    "DetectableDifference",
    "Difference",
    "EProcess",
    "FurtherLoss",
    "Interval",
    "IntervalMethod",
    "Outcomes",
    "PairedTable",
    "Question",
    "RankCorrelation",
    "RankingArea",
    "Rate",
    "Reading",
    "StoppingRule",
    "Threshold",
    "Verdict",
    "anytime_interval",
    "barnard_p",
    "barnard_p_values",
    "boschloo_p",
    "chance_p",
    "clopper_pearson_interval",
    "clustered_mean",
    "compact_letters",
    "decide",
    "delta_success_rate",
    "difference_of",
    "discordant_e_process",
    "e_benjamini_hochberg",
    "evidence_above",
    "evidence_below",
    "exchange_p",
    "fisher_p",
    "fit_threshold",
    "guessing_p",
    "holm",
    "mcnemar_p",
    "mean_of_rates",
    "newcombe_difference",
    "newcombe_paired_difference",
    "paired_bootstrap",
    "paired_power",
    "percent",
    "rank_correlation",
    "ranking_area",
    "ratio_of",
    "round_half_up",
    "sign_flip_p",
    "smallest_paired_difference",
    "smallest_unpaired_difference",
    "two_rate_e_process",
    "unpaired_power",
    "wider_paired_difference",
    "wilson_interval",
]
