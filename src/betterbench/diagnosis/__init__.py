"""Diagnosis: labels and explanations for a policy's trials, from their records alone.

- ``analysis``: the events of one episode: approaches, grasp attempts, halts, collisions, harm.
- ``modes``: one file per failure mode, with the rule that recognizes it.
- ``thresholds``: the numbers that labels depend on.
- ``trial``, ``labels``, ``ruling``: each trial's label, from the evidence of all modes; ``readers`` chooses how to read
  a world's records, and ``libero`` reads LIBERO records.
- ``rule_likelihood``, ``task_rules``, ``second_pass``: the rule that explains a policy's wrong first attempts
  (likelihood of one rule, rules in one task, rules over all tasks). ``instruction_effect``, ``favorite_thing``,
  ``decider``: use of the instruction by the policy.
- ``run``, ``stored``, ``changes``: a run's diagnosis, its file, and the differences between two diagnoses.
- ``measures``: a run's metrics, and the confusion and power matrices of the diagnosis itself.
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
