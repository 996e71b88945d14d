"""Calibration: the diagnosis measured on policies whose fault is known, as a test suite is measured by mutation."""

from betterbench.calibration.policies import CalibrationPolicy, calibration_policies
from betterbench.calibration.probes import probe_cells
from betterbench.calibration.run import CalibrationProgress, calibrate
from betterbench.calibration.truth import true_label

__all__ = ["CalibrationPolicy", "CalibrationProgress", "calibrate", "calibration_policies", "probe_cells", "true_label"]
