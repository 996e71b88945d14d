"""Synthetic diagnoses with the shape of real runs: seeded, with the metrics that the diagnosis itself computes."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw

from betterbench.diagnosis.measures.metrics import compute_metrics
from betterbench.diagnosis.verdict import Attempt, Evidence, Label, RunDiagnosis, TrialDiagnosis
from betterbench.report import Film, Frame, Showing
from betterbench.tasks import THRESHOLDS, Condition, Task, get_task

POLICIES = ("expert", "zoo:lexical", "zoo:inertia", "zoo:progress-cue")
VERSIONS = {"package": "0.1.0", "record schema": "1", "mujoco": "3.17.0", "fast_food": "1", "morning_coffee": "1"}

_FAULTS: dict[str, dict[str, tuple[Label, float]]] = {
    "expert": {},
    "zoo:lexical": {f"morning_coffee/L{i}": (Label.LEXICAL_KINEMATIC_SHORTCUT, 1.0) for i in range(1, 5)}
    | {
        "morning_coffee/O1": (Label.SEMANTIC_FEATURE_COLLAPSE, 1.0),
        "fast_food/L1": (Label.LEXICAL_KINEMATIC_SHORTCUT, 0.95),
        "fast_food/O1": (Label.SEMANTIC_FEATURE_COLLAPSE, 0.9),
    },
    "zoo:inertia": {
        "fast_food/R1": (Label.BEHAVIORAL_INERTIA, 1.0),
        "fast_food/R2": (Label.BEHAVIORAL_INERTIA, 0.95),
        "morning_coffee/T1": (Label.BEHAVIORAL_INERTIA, 0.6),
    },
    "zoo:progress-cue": {
        "fast_food/T1": (Label.CAUSAL_CONFUSION, 0.9),
        "fast_food/T2": (Label.ORDER_VIOLATION, 0.5),
        "fast_food/O1": (Label.CAUSAL_CONFUSION, 0.7),
        "morning_coffee/T1": (Label.PHASE_CONFLICT, 0.3),
    },
}
_ELSEWHERE: dict[str, dict[str, tuple[Label, float]]] = {
    "zoo:lexical": {
        "L": (Label.LEXICAL_KINEMATIC_SHORTCUT, 0.8),
        "R": (Label.WRONG_OBJECT, 0.2),
        "O": (Label.SEMANTIC_FEATURE_COLLAPSE, 0.7),
        "T": (Label.EARLY_HALT, 0.3),
    },
    "zoo:inertia": {"R": (Label.BEHAVIORAL_INERTIA, 0.9)},
    "zoo:progress-cue": {"T": (Label.CAUSAL_CONFUSION, 0.8)},
}
"""Faults on the tasks that ``_FAULTS`` does not name, by the letter of the axis."""
_CLUMSY = {"expert": 0.0, "zoo:lexical": 0.03, "zoo:inertia": 0.04, "zoo:progress-cue": 0.05}


def trial(
    task: str = "fast_food",
    variation: str | None = "T1",
    condition: str = "train1",
    seed: int = 0,
    *,
    label: Label = Label.SUCCESS,
    policy: str = "expert",
    axis: str | None = "temporal_extrapolation",
    **changes: object,
) -> TrialDiagnosis:
    """Returns one trial; what is not named is plausible."""
    right = label.kind.value == "none"
    attempts = (
        Attempt(2.1, 2.7, "burger_1" if right else "fries", "first", "target" if right else "distractor", True),
    )
    base = TrialDiagnosis(
        task,
        variation,
        condition,
        axis if variation else None,
        seed,
        policy,
        "Put a burger into the takeaway box, then the fries.",
        right,
        "succeed",
        label,
        "burger_1" if right else "fries",
        "burger" if right else "fries",
        "first" if right else "third",
        "burger_1",
        "burger",
        ("burger_1",),
        right or label.kind.value == "execution",
        1.0 if right else 0.25,
        attempts,
        Evidence(label.value, f"The record shows {label.value.replace('_', ' ')}.", 2.1, 2.9, ("fries",)),
        0,
        240,
        12.0,
        f"records/{task}/{variation or condition}/{seed}.parquet",
    )
    return replace(base, **changes)  # type: ignore[arg-type]


def diagnosis(
    trials: Sequence[TrialDiagnosis], *, policy: str = "expert", findings: Sequence[str] = (), notes: Sequence[str] = ()
) -> RunDiagnosis:
    """Returns the diagnosis of trials with the metrics that the diagnosis package computes."""
    mine = tuple(replace(t, policy=policy) for t in trials)
    thresholds = THRESHOLDS.to_json()
    return RunDiagnosis(policy, mine, compute_metrics(mine), tuple(findings), tuple(notes), thresholds, dict(VERSIONS))


def run_of(policy: str, *, seeds: int = 20, tasks: Sequence[str] = ("fast_food", "morning_coffee")) -> RunDiagnosis:
    """Returns a run of a known policy over whole tasks: every training condition and variation with every seed."""
    generator = np.random.default_rng([ord(c) for c in policy])
    trials = []
    for name in tasks:
        task = get_task(name)
        for condition in task.training:
            trials += [_played(policy, task, condition, None, seed, generator=generator) for seed in range(seeds)]
        for variation in task.variations:
            base = next(c for c in task.training if c.name == variation.base)
            trials += [_played(policy, task, base, variation.name, seed, generator=generator) for seed in range(seeds)]
    notes = ("The smallest difference that 240 pairs detect at 80 % power is 3.3 percentage points.",)
    findings = {
        "zoo:lexical": (
            "Goes where the word led in training, to another object: 80/80 trials of morning_coffee L1, L2, L3, L4.",
            "Goes for an object that no instruction asks to move: 20/20 trials of morning_coffee O1.",
        ),
        "zoo:inertia": ("Repeats a step of training that was not requested: 39/40 trials of fast_food R1, R2.",),
        "zoo:progress-cue": ("Skips a required step or repeats a finished one: 32/40 trials of fast_food O1, T1.",),
    }
    return diagnosis(trials, policy=policy, findings=findings.get(policy, ()), notes=notes)


def _played(
    policy: str, task: Task, base: Condition, variation: str | None, seed: int, *, generator: np.random.Generator
) -> TrialDiagnosis:
    known = next((v for v in task.variations if v.name == variation), None)
    instruction = base.instruction
    if known is not None:
        for operation in known.interventions:
            instruction = operation.arguments.get("instruction", instruction)
    still = known is not None and known.expected.value == "stay_still"
    faults = _FAULTS if task.id in ("fast_food", "morning_coffee") else _ELSEWHERE
    cell = f"{task.id}/{variation}" if faults is _FAULTS else (variation or " ")[0]
    fault, rate = faults.get(policy, {}).get(cell, (Label.SUCCESS, 0.0))
    label = Label.CORRECT_FREEZE if still else Label.SUCCESS
    if generator.random() < rate:
        label = fault
    elif generator.random() < _CLUMSY.get(policy, 0.0):
        label = Label.EXECUTION_FAILURE if generator.random() < 0.7 else Label.TIMEOUT
    start = float(np.round(generator.uniform(1.8, 3.2), 2))
    asked = instruction.subgoals[0].word
    attempts = (
        ()
        if label in (Label.CORRECT_FREEZE, Label.PHASE_CONFLICT)
        else (
            Attempt(
                start,
                start + 0.55,
                asked if label.kind.value in ("none", "execution") else "burger",
                "first",
                "target" if label.kind.value in ("none", "execution") else "distractor",
                label is not Label.EXECUTION_FAILURE,
            ),
            Attempt(start + 4.1, start + 4.7, "fries", "third", "target", True),
        )
    )
    duration = float(np.round(generator.uniform(10, 19), 2))
    return trial(
        task.id,
        variation,
        base.name,
        seed,
        label=label,
        policy=policy,
        axis=known.axis.value if known is not None else None,
        instruction=instruction.text,
        expected=known.expected.value if known is not None else "succeed",
        attempts=attempts,
        duration_s=duration,
        steps=int(duration * 20),
        intended=None if still else asked,
        intended_kind=None if still else asked,
        intended_any=() if still else (asked,),
        first_attempt=attempts[0].object if attempts else None,
        evidence=Evidence(
            label.value,
            f"The first grasp, {start:.1f} s in, is at the {attempts[0].object if attempts else 'nothing'}; "
            f"the instruction asks for the {asked}.",
            start,
            start + 0.6,
            shared=("color", "slot") if label is Label.SEMANTIC_FEATURE_COLLAPSE else (),
        ),
    )


def draw_frame(generator: np.random.Generator, *, size: int = 192) -> bytes:
    """Returns a small JPEG that looks a little like a table."""
    image = Image.new("RGB", (size, size), (196, 190, 180))
    pen = ImageDraw.Draw(image)
    pen.rectangle((0, size * 0.45, size, size), fill=(150, 118, 88))
    for color in ((190, 60, 50), (60, 90, 170), (220, 180, 60)):
        x, y = generator.uniform(0.15, 0.8, 2) * size
        pen.ellipse((x, max(y, size * 0.5), x + 24, max(y, size * 0.5) + 20), fill=color)
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=80)
    return buffer.getvalue()


def film_of(showing: Showing, image: Callable[[], bytes]) -> Film:
    """Returns the film that was asked for, with any images."""
    frames = tuple(Frame(t, image(), c) for t, c in zip(showing.times_s, showing.captions, strict=True))
    twin = tuple(Frame(t, image(), c) for t, c in zip(showing.twin_times_s, showing.twin_captions, strict=True))
    return Film(showing.policy, showing.trial, frames, showing.twin, twin, showing.evidence_s)
