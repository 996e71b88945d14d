"""Calibration: measures how accurate the diagnosis is, using policies with known faults.

The idea is similar to mutation testing of software.
"""

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
