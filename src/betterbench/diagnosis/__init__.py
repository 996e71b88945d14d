"""Diagnosis: a label with an explanation for each trial of a policy, computed only from its record.

- ``analysis``: the events of one episode: approaches, grasp attempts, halts, collisions, harm.
- ``modes``: one file per failure mode, with its detector.
- ``thresholds``: the thresholds of the detectors.
- ``trial``, ``labels``, ``ruling``: the label of each trial, from the evidence of all modes. ``readers`` selects the
  reader for a world's records, and ``libero`` reads LIBERO records.
- ``rule_likelihood``, ``task_rules``, ``second_pass``: the rule that explains a policy's wrong first attempts
  (likelihood of one rule, rules in one task, rules over all tasks). ``instruction_effect``, ``favorite_thing``,
  ``decider``: use of the instruction, or the cue that the policy uses instead.
- ``run``, ``stored``, ``changes``: the diagnosis of a run, its file, and the differences between two diagnoses.
- ``measures``: the metrics of a run, and the confusion and power matrices of the diagnosis itself.
"""

from betterbench.diagnosis.measures.confusion import Calibration, Judged, LabelScore, packaged_calibration
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
