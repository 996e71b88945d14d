"""Diagnosis of a run: a label and an explanation for each trial of a policy, computed from the trial's record alone.

- ``analysis``: the events of one episode, such as approaches, grasp attempts, halts, collisions and harm.
- ``modes``: one file per failure mode, with its detector.
- ``thresholds``: the thresholds of the detectors.
- ``trial``, ``labels``, ``ruling``: the label of each trial, chosen from the evidence of all failure modes. ``readers``
  selects the function that reads the records of a simulated world, and ``libero`` reads those of LIBERO.
- ``rule_likelihood``, ``task_rules``, ``second_pass``: the decision rule that explains a policy's wrong first attempts
  (the likelihood of one rule, the rules in one task, the rules over all tasks). ``instruction_effect``,
  ``favorite_thing`` and ``decider`` test whether the policy uses the instruction, or which cue it uses instead.
- ``run``, ``stored``, ``changes``: the diagnosis of a whole run, the file that stores it, and the differences between
  two diagnoses.
- ``measures``: the metrics of a run, and the confusion and power matrices that measure the diagnosis itself.
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
