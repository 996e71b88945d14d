"""Calibration: accuracy of the diagnosis, measured on policies with known faults, similar to mutation testing."""

from betterbench.calibration.policies import CalibrationPolicy, calibration_policies
from betterbench.calibration.power import PowerTrials, measure_power, power_trials
from betterbench.calibration.run import CalibrationProgress, calibrate
from betterbench.calibration.truth import true_label

__all__ = [
    "CalibrationPolicy",
    "CalibrationProgress",
    "PowerTrials",
    "calibrate",
    "calibration_policies",
    "measure_power",
    "power_trials",
    "true_label",
]
