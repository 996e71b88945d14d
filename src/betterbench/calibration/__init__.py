"""Calibration: measurement of the accuracy of the diagnosis with policies that have known faults.

As in mutation testing of software, faults are planted on purpose, and the diagnosis should find them.
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
