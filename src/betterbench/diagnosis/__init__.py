"""Diagnosis: from records alone, what each policy did right or wrong and for which reason."""

from betterbench.diagnosis.confusion import Calibration, Judged, LabelScore, packaged_calibration
from betterbench.diagnosis.run import diagnose_records, diagnose_run
from betterbench.diagnosis.trial import diagnose_record, offline_truth
from betterbench.diagnosis.verdict import Attempt, Evidence, Metric, RunDiagnosis, TrialDiagnosis
from betterbench.tasks.labels import Kind, Label

__all__ = [
    "Attempt",
    "Calibration",
    "Evidence",
    "Judged",
    "Kind",
    "Label",
    "LabelScore",
    "Metric",
    "RunDiagnosis",
    "TrialDiagnosis",
    "diagnose_record",
    "diagnose_records",
    "diagnose_run",
    "offline_truth",
    "packaged_calibration",
]
