"""Label of a trial on a real arm, from joint signals and the entries of judges who watched the video.

The labels and the rules for rest and back-and-forth motion are the same as in the simulated diagnosis. Only the judges
can tell which object was taken and which objects are in the basket. If the signals and the judges together do not
determine a label, the label is None and the trial is unscored. If the joint states contradict an entry, the
contradiction is reported, and the trial is unscored until the judges enter a new outcome.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from betterbench.diagnosis.exposure import Exposure
from betterbench.diagnosis.thresholds import DOUBT, HALT_RADIUS, HELD_SHARE
from betterbench.real.outcomes import outcome_named
from betterbench.real.record import Entry, RealTrial
from betterbench.real.signals import Closing, JointSignals, JointTrack, signals_of
from betterbench.tasks import Expected
from betterbench.tasks.labels import Label
from betterbench.tasks.thresholds import EMPTY_SLOT_REACH, THRESHOLDS
from betterbench.wording import listed, plural

Basis = Literal["joints", "judges", "joints and judges", "record", "nothing"]
"""Source of a label."""

UNSCORED = "unscored"
"""Text that replaces a missing label in tables and JSON."""


@dataclass(frozen=True, slots=True)
class Judged:
    """Combined entries of the judges of a trial.

    Attributes:
        outcome: Outcome entered by more than half of the judges, or None.
        why_open: Sentence that explains why there is no such outcome; empty if there is one.
        votes: Outcome entered by each judge, by the judge's name.
        operator: Outcome entered by the operator, or None. It does not affect the label, because the operator knows the
            condition.
        notes: Notes of the judges, each preceded by the name of its author.
    """

    outcome: str | None
    why_open: str
    votes: dict[str, str]
    operator: str | None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, entries: Sequence[Entry]) -> Judged:
        """Combine the current entries of all people about one attempt at a trial."""
        seen = [(entry, entry.decision) for entry in entries if entry.decision.kind == "seen"]
        votes = {entry.author: decision.outcome for entry, decision in seen if entry.role == "judge"}
        operators = [decision.outcome for entry, decision in seen if entry.role == "operator"]
        operator = operators[-1] if operators else None
        notes = tuple(
            f"{entry.author}: {decision.note}" for entry, decision in seen if entry.role == "judge" and decision.note
        )
        if not votes:
            seen_by = (
                ""
                if operator is None
                else f" The operator, who is not blind, entered '{outcome_named(operator).title}'."
            )
            return cls(None, f"No judge has seen the video.{seen_by}", votes, operator, notes)
        ranked = Counter(votes.values()).most_common()
        if 2 * ranked[0][1] <= len(votes):
            told = listed([f"{name}: {outcome_named(outcome).title}" for name, outcome in sorted(votes.items())])
            return cls(None, f"The judges disagree ({told}); a further judge decides.", votes, operator, notes)
        return cls(ranked[0][0], "", votes, operator, notes)


@dataclass(frozen=True, slots=True)
class RealLabel:
    """Label of one trial, with its evidence.

    Attributes:
        label: Label, or None for a trial that is not scored.
        rule: Name of the rule that determined the label. Rules of the simulated diagnosis keep their names.
        text: Evidence in one or more sentences.
        start_s: Beginning of the evidence [s].
        end_s: End of the evidence [s].
        basis: Source of the label.
        contradiction: Description of the judges' entry and of the joint states that contradict it; empty if there is no
            contradiction.
    """

    label: Label | None
    rule: str
    text: str
    start_s: float
    end_s: float
    basis: Basis
    contradiction: str = ""

    @property
    def name(self) -> str:
        """Name of the label, or "unscored" if there is none."""
        return UNSCORED if self.label is None else self.label.value

    def to_json(self) -> dict[str, Any]:
        """Return the label as a JSON-serializable dict."""
        return {**asdict(self), "label": self.name}


@dataclass(frozen=True, slots=True)
class Place:
    """Location at which the jaw of the gripper closed.

    Attributes:
        object: Kind of the object that was at the location at the start; None for an empty slot or an unknown location.
        slot: Name of the slot, or None if the location is unknown.
        gap_m: Horizontal distance to the slot's center, minus the slot's jitter [m].
    """

    object: str | None
    slot: str | None
    gap_m: float


@dataclass(frozen=True, slots=True)
class Setting:
    """Properties of a condition on which the labels of its trials depend.

    Attributes:
        exposure: Comparison of the condition with the training conditions, which determines the expected behavior.
        due: Kinds of the objects to pack, in order.
        half_done: Whether the scene looks like the middle of a demonstration.
        rest_absent: Whether the scene looks half done, and an object named in the instruction of the training twin (the
            training trial with the same seed) is absent.
    """

    exposure: Exposure
    due: tuple[str, ...]
    half_done: bool
    rest_absent: bool

    @classmethod
    def of(cls, task: str, condition: str) -> Setting:
        """Return the properties of a condition on which labels depend.

        Raise UnknownNameError for an unknown condition.
        """
        x = Exposure.of(task, condition)
        due = tuple(kind for goal in x.open_goals for kind in sorted(x.kinds(goal)))
        here = {o.kind for o in x.test.objects if o.name in x.test.layout or o.name in x.test.preplaced}
        asked = {goal.reference.kind for goal in x.base.instruction.subgoals if goal.reference.kind is not None}
        return cls(x, due, x.test.mid_task_look, x.test.mid_task_look and not asked <= here)

    @property
    def expected(self) -> Expected:
        """Expected behavior of a policy that understands the instruction."""
        return self.exposure.test.expected

    def place_of(self, closing: Closing) -> Place:
        """Return the object or empty training slot closest to the position where the jaw closed, if it is close enough.

        Objects are assumed to be at their initial positions, within the jitter of their slots. As in the simulated
        diagnosis, an object that the instruction names is preferred to an empty slot, unless the object is farther away
        by more than ``doubt``.
        """
        x, picked = self.exposure, {s for slots in self.exposure.trained.kind_slots.values() for s in slots}
        found: list[Place] = []
        for slot in x.task.slots:
            gap = max(0.0, math.dist((closing.x, closing.y), (slot.x, slot.y)) - slot.jitter_m)
            kind = x.movable_in(slot.name)
            if kind is not None and gap <= max(THRESHOLDS.slot_reach, EMPTY_SLOT_REACH):
                found.append(Place(kind, slot.name, gap))
            elif kind is None and slot.name in picked and gap <= EMPTY_SLOT_REACH:
                found.append(Place(None, slot.name, gap))
        best = min(found, key=lambda place: place.gap_m, default=Place(None, None, math.inf))
        if best.object is None or best.object not in self.due:
            missed = [p for p in found if p.object in self.due and p.gap_m <= best.gap_m + DOUBT]
            best = min(missed, key=lambda place: place.gap_m, default=best)
        return best

    def trained_at(self, slot: str) -> str:
        """Return a string that lists the kinds of objects picked from the given slot during training."""
        kinds = [kind for kind, slots in sorted(self.exposure.trained.kind_slots.items()) if slot in slots]
        return listed([f"the {kind}" for kind in kinds])

    def in_basket(self, closing: Closing) -> bool:
        """Return whether the jaw closed at the position of a container."""
        x = self.exposure
        stands = [x.task.slot(x.test.layout[o.name]) for o in x.test.objects if o.role == "container"]
        return any(math.dist((closing.x, closing.y), (s.x, s.y)) <= THRESHOLDS.home_radius for s in stands)


def label_trial(trial: RealTrial, task: str) -> tuple[RealLabel, JointSignals | None, Judged]:
    """Return the label of a finished trial, the joint signals, and the combined entries of the judges.

    The signals are None if the trial is too short.

    Raises:
        RecordError: If the samples of the trial are missing, changed or damaged.
    """
    judged, header = Judged.of(trial.entries), trial.header
    if header.steps < 2:
        text = f"The record has {plural(header.steps, 'control step')}, too few to judge the trial."
        return RealLabel(None, "no_record", text, 0.0, 0.0, "record"), None, judged
    samples = trial.samples()
    signals = signals_of(JointTrack.of(samples, unit=header.unit, rate_hz=header.rate_hz))
    label = label_of(
        Setting.of(task, trial.planned.condition), signals, judged, held_share=header.held_steps / header.steps
    )
    return label, signals, judged


def label_of(setting: Setting, signals: JointSignals, judged: Judged, *, held_share: float = 0.0) -> RealLabel:
    """Return the label of a trial.

    Args:
        setting: Properties of the trial's condition.
        signals: Joint signals.
        judged: Combined entries of the judges.
        held_share: Fraction of the control steps in which the policy gave no answer in time.
    """
    end = signals.duration_s
    if judged.outcome is not None and not outcome_named(judged.outcome).scored:
        text = f"The judges entered '{outcome_named(judged.outcome).title}'."
        return RealLabel(None, judged.outcome, text, 0.0, end, "judges")
    if held_share >= HELD_SHARE:
        text = f"The policy gave no answer in time in {held_share:.0%} of the control steps."
        return RealLabel(Label.POLICY_ERROR, "late_answers", text, 0.0, end, "record")
    problem = contradiction_of(setting, signals, judged.outcome)
    if problem:
        text = f"{problem} Neither is trusted: check the video and the joint states, and enter the outcome again."
        return RealLabel(None, "contradiction", text, 0.0, end, "nothing", problem)
    if not signals.moved:
        return _never_moved(setting, signals, judged)
    if judged.outcome is None:
        text = f"{judged.why_open} {_summary(signals)}"
        return RealLabel(None, "not_judged", text, 0.0, end, "nothing")
    return _BY_OUTCOME[judged.outcome](setting, signals, judged)


def contradiction_of(setting: Setting, signals: JointSignals, outcome: str | None) -> str:
    """Describe in one or two sentences how the joint states contradict an outcome.

    Return an empty string if they do not.
    """
    if outcome is None:
        return ""
    said = f"The judges entered '{outcome_named(outcome).title}'"
    packs = outcome == "part" or (outcome == "done" and bool(setting.due))
    if packs or outcome in ("air_grasp", "oscillated", "wrong_object", "missed", "undid"):
        if not signals.moved:
            return f"{said}, but the arm never moved: its tool stayed within {HALT_RADIUS * 100:.0f} cm of its start."
        if (packs or outcome == "air_grasp") and not signals.attempts:
            return f"{said}, but the jaw never closed near the table."
    if packs and not signals.grasps:
        return f"{said}, but the jaw never closed on anything: {_openings(signals)}."
    if outcome == "part" and len(setting.due) < 2:
        count = plural(len(setting.due), "object")
        return f"{said}, but the condition has {count} to pack, so that no part of it can be done."
    if outcome == "air_grasp" and not any(not c.holds for c in signals.attempts):
        return f"{said}, but every closing of the jaw was on something: {_openings(signals)}."
    if outcome == "froze" and signals.attempts:
        first = signals.attempts[0]
        return f"{said}, but the jaw closed {first.z * 100:.0f} cm above the table after {first.start_s:.1f} s."
    if (
        outcome == "froze"
        and signals.freeze is None
        and (signals.to_and_fro is not None or signals.reach_m > THRESHOLDS.home_radius)
    ):
        return f"{said}, but the tool went {signals.reach_m * 100:.0f} cm away from its start and did not come to rest."
    return ""


# ------------------------------------------------------------------------------------------------------- by behavior


def _never_moved(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    """Return the label for a trial in which the arm never moved.

    No judge is needed, because the joint states show this.
    """
    basis: Basis = "joints" if judged.outcome is None else "joints and judges"
    still = f"The arm never moved in {signals.duration_s:.0f} s"
    if setting.expected is Expected.STAY_STILL:
        text = f"{still}, and no step was left to do."
        return RealLabel(Label.CORRECT_FREEZE, "goal", text, 0.0, signals.duration_s, basis)
    if setting.expected.lacks_target:
        text = f"{still}. The target is absent, and no other object was touched."
        return RealLabel(Label.CORRECT_REFUSAL, "goal", text, 0.0, signals.duration_s, basis)
    return _halt(setting, signals, basis, 0.0, still)


def _halt(setting: Setting, signals: JointSignals, basis: Basis, start_s: float, still: str) -> RealLabel:
    """Return the label for a trial in which the arm stands still although steps are left to do.

    The label is phase conflict I if the scene looks like the middle of a demonstration and no grasp was attempted.
    In all other cases, it is early halt.
    """
    left = listed([f"the {kind}" for kind in setting.due])
    if setting.half_done and not signals.attempts:
        text = f"{still}, and the scene looks like the middle of a demonstration (phase conflict I). Due: {left}."
        return RealLabel(Label.PHASE_CONFLICT, "freeze_in_mid_task_scene", text, start_s, signals.duration_s, basis)
    text = f"{still}, although steps are left to do. Due at the start: {left}."
    return RealLabel(Label.EARLY_HALT, "still_with_open_subgoals", text, start_s, signals.duration_s, basis)


def _done(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    """Return the label for a trial in which the judges saw every requested object in the basket at the end."""
    del judged
    if not setting.due:
        return _nothing_due(setting, signals)
    released = [c.over_s for c in signals.grasps if c.let_go_s is not None]
    after = [c for c in signals.attempts if not c.holds and released and c.start_s > released[-1]]
    for closing in after:
        inertia = _empty_slot(setting, closing)
        if inertia is not None:
            text = f"Every requested object is packed, and then {inertia}"
            rule = "air_grasp_at_memorized_slot"
            return RealLabel(Label.BEHAVIORAL_INERTIA, rule, text, closing.start_s, closing.over_s, "joints and judges")
    extra = "" if not after else f" Then {_at(after[0])}, not at a training slot."
    text = f"The judges saw every requested object in the basket; {_grips(signals)}.{extra}"
    end = released[-1] if released else signals.duration_s
    return RealLabel(Label.SUCCESS, "goal", text, end, end, "joints and judges")


def _nothing_due(setting: Setting, signals: JointSignals) -> RealLabel:
    """Return the label of a trial in which the arm moves although nothing is left to do in the scene."""
    end = signals.duration_s
    if signals.grasps:
        first = signals.grasps[0]
        if setting.in_basket(first):
            text = f"Nothing was left to do, and {_at(first)}, in the basket: it takes out a packed object."
            return RealLabel(
                Label.CAUSAL_CONFUSION, "finished_step_repeated", text, first.start_s, first.over_s, "joints and judges"
            )
        text = (
            f"The judges saw nothing wrong at the end, but {_at(first)}, outside the basket, although nothing was "
            f"left to do. The object is not known."
        )
        return RealLabel(None, "unknown_object", text, first.start_s, first.over_s, "nothing")
    if signals.attempts:
        return _air_grasp(setting, signals)
    if signals.to_and_fro is not None:
        return _sway(setting, signals)
    if signals.at_rest:
        label = Label.CORRECT_REFUSAL if setting.expected.lacks_target else Label.CORRECT_FREEZE
        start = signals.freeze.start_s if signals.freeze is not None else 0.0
        why = "The target is absent" if setting.expected.lacks_target else "No step was left to do"
        text = f"{why}, the jaw never closed, and the arm came to rest after {start:.1f} s."
        return RealLabel(label, "goal", text, start, end, "joints and judges")
    text = "No step was left to do, but the arm did not come to rest before the end; it made no grasp attempt."
    return RealLabel(Label.TIMEOUT, "no_rest", text, 0.0, end, "joints and judges")


def _part(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    """Return the label for a trial in which only some objects were packed and the arm reached for no other object."""
    del judged
    last = max((c.over_s for c in signals.grasps if c.let_go_s is not None), default=0.0)
    after = [c for c in signals.attempts if c.start_s > last]
    empty = next((text for c in after if not c.holds and (text := _empty_slot(setting, c))), None)
    if empty is not None:
        text = f"Some of the objects are packed, and then {empty}"
        first = next(c for c in after if not c.holds)
        rule = "air_grasp_at_memorized_slot"
        return RealLabel(Label.BEHAVIORAL_INERTIA, rule, text, first.start_s, first.over_s, "joints and judges")
    if after:
        text = f"Some objects are packed, and then {_at(after[-1])}: another object is missed or lost."
        return RealLabel(
            Label.EXECUTION_FAILURE, "missed", text, after[-1].start_s, after[-1].over_s, "joints and judges"
        )
    if signals.freeze is not None:
        still = f"Some objects are packed, and then the arm stands still from {signals.freeze.start_s:.1f} s to the end"
        return _halt(setting, signals, "joints and judges", signals.freeze.start_s, still)
    if signals.to_and_fro is not None:
        return _sway(setting, signals)
    text = "Some of the objects are packed, and the arm is still moving at the time limit."
    return RealLabel(Label.TIMEOUT, "step_limit", text, last, signals.duration_s, "joints and judges")


def _froze(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    """Return the label for a trial in which the judges saw the arm stand still."""
    del judged
    if not setting.due:
        return _nothing_due(setting, signals)
    start = signals.freeze.start_s if signals.freeze is not None else 0.0
    still = (
        f"The judges saw the arm stand still; its tool stayed within {signals.reach_m * 100:.0f} cm of its start and "
        f"rests from {start:.1f} s"
        if signals.freeze is not None
        else f"The judges saw the arm stand still; its tool moved by up to {signals.reach_m * 100:.0f} cm"
    )
    return _halt(setting, signals, "joints and judges", start, still)


def _grasped_nothing(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    del judged
    return _air_grasp(setting, signals)


def _air_grasp(setting: Setting, signals: JointSignals) -> RealLabel:
    """Return the label for a trial in which the judges saw the jaw close without an object."""
    empty = [c for c in signals.attempts if not c.holds]
    last = empty[-1]
    if setting.rest_absent and setting.expected is Expected.STAY_STILL:
        text = (
            f"The scene looks half done and the next object is absent: {_at(last)}, instead of coming to rest (phase "
            "conflict II)."
        )
        return RealLabel(
            Label.PHASE_CONFLICT, "air_grasp_in_mid_task_scene", text, last.start_s, last.over_s, "joints and judges"
        )
    for closing in reversed(empty):
        inertia = _empty_slot(setting, closing)
        if inertia is not None:
            rule, text = "air_grasp_at_memorized_slot", inertia[0].upper() + inertia[1:]
            return RealLabel(Label.BEHAVIORAL_INERTIA, rule, text, closing.start_s, closing.over_s, "joints and judges")
    place = setting.place_of(last)
    near = f", {place.gap_m * 100:.0f} cm from the {place.object}" if place.object else ", far from every object"
    text = f"The judges saw a grasp without an object: {_at(last)}{near}: a miss without a clear target."
    return RealLabel(Label.EXECUTION_FAILURE, "missed", text, last.start_s, last.over_s, "joints and judges")


def _oscillated(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    del judged
    return _sway(setting, signals)


def _sway(setting: Setting, signals: JointSignals) -> RealLabel:
    """Return the label for a trial with back-and-forth motion."""
    span = signals.to_and_fro
    start = 0.0 if span is None else span.start_s
    seen = (
        f"The empty gripper moves back and forth from {start:.1f} s until the end, {signals.path_m:.1f} m in total"
        if span is not None
        else f"The judges saw the arm move back and forth; its tool moved {signals.path_m:.1f} m in total"
    )
    basis: Basis = "joints and judges"
    if setting.due or setting.rest_absent:
        which = " (phase conflict II)" if setting.rest_absent and not setting.due else ""
        return RealLabel(
            Label.PHASE_CONFLICT, "to_and_fro", f"{seen}, and grasps nothing{which}.", start, signals.duration_s, basis
        )
    text = f"{seen}, although nothing was left to do, and does not come to rest."
    return RealLabel(Label.TIMEOUT, "no_rest", text, start, signals.duration_s, basis)


def _wrong_object(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    """Return the label for a trial in which the judges saw the arm grasp a wrong object.

    The label depends on the position at which the jaw closed.
    """
    del judged
    others = []
    for closing in signals.grasps or signals.attempts:
        place = setting.place_of(closing)
        if place.object is not None and place.object not in setting.due:
            others.append((closing, place.object))
    if not others:
        text = f"The judges saw the arm take a wrong object; {_grips(signals)}. The object is not known."
        return RealLabel(Label.WRONG_OBJECT, "other_object", text, 0.0, signals.duration_s, "judges")
    closing, kind = others[0]
    text = f"The judges saw the arm take a wrong object, and {_at(closing)}, where the {kind} stood."
    known = kind in setting.exposure.trained.kind_slots
    label = Label.WRONG_OBJECT if known else Label.SEMANTIC_FEATURE_COLLAPSE
    rule = "object_of_another_instruction" if known else "object_that_no_instruction_means"
    return RealLabel(label, rule, text, closing.start_s, closing.over_s, "joints and judges")


def _missed(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    """Return the label for a trial in which the judges saw a failed attempt at a correct object."""
    del setting, judged
    lost = [c for c in signals.grasps if c.lost_s is not None]
    last = lost[-1] if lost else signals.attempts[-1] if signals.attempts else None
    if last is None:
        text = "The judges saw a failed attempt at a requested object; the jaw never closed near the table."
        return RealLabel(Label.EXECUTION_FAILURE, "never_closes", text, 0.0, signals.duration_s, "judges")
    how = "an object slipped out of the closed jaw" if lost else _at(last)
    text = f"The judges saw a failed attempt at a requested object; {how}."
    rule = "slipped" if lost else "missed"
    return RealLabel(Label.EXECUTION_FAILURE, rule, text, last.start_s, last.over_s, "joints and judges")


def _undid(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    del judged
    at = next((c for c in signals.attempts if setting.in_basket(c)), None)
    where = "the joints show no closing near the basket" if at is None else f"{_at(at)}, in the basket"
    text = f"The judges saw an object being grasped in the basket or taken out of it; {where}."
    start, end = (0.0, signals.duration_s) if at is None else (at.start_s, at.over_s)
    basis: Basis = "judges" if at is None else "joints and judges"
    return RealLabel(Label.CAUSAL_CONFUSION, "finished_step_repeated", text, start, end, basis)


def _other(setting: Setting, signals: JointSignals, judged: Judged) -> RealLabel:
    del setting
    text = f"The judges saw something else ({'; '.join(judged.notes)}). {_summary(signals)}"
    return RealLabel(None, "other", text, 0.0, signals.duration_s, "judges")


_BY_OUTCOME = {
    "done": _done,
    "part": _part,
    "froze": _froze,
    "air_grasp": _grasped_nothing,
    "oscillated": _oscillated,
    "wrong_object": _wrong_object,
    "missed": _missed,
    "undid": _undid,
    "other": _other,
}
"""Function that labels a trial, for each scored outcome."""


# ------------------------------------------------------------------------------------------------------------ wording


def _empty_slot(setting: Setting, closing: Closing) -> str | None:
    """Return a clause that says at which empty training slot the jaw closed, or None if it closed elsewhere."""
    place = setting.place_of(closing)
    if closing.holds or place.slot is None or place.object is not None:
        return None
    there = setting.trained_at(place.slot)
    return f"{_at(closing)}, at the empty slot {place.slot!r}, where {there} was picked in training."


def _at(closing: Closing) -> str:
    """Return a clause that describes one closing of the jaw."""
    on = "on something" if closing.holds else "on nothing"
    where = f"({closing.x:.2f}, {closing.y:.2f}) m"
    return f"the jaw closes {on} at {where} after {closing.start_s:.1f} s (opening {closing.opening:.0f} %)"


def _openings(signals: JointSignals) -> str:
    """Return a clause that states the openings at which the jaw stopped."""
    if not signals.closings:
        return "it kept its opening"
    return f"it stopped at {listed([f'{c.opening:.0f} %' for c in signals.closings])}"


def _grips(signals: JointSignals) -> str:
    """Return a clause with the number of times that the jaw closed on something."""
    return f"the jaw closed on something {plural(len(signals.grasps), 'time')}"


def _summary(signals: JointSignals) -> str:
    """Return a sentence that summarizes the joint signals."""
    parts = [f"{plural(len(signals.grasps), 'closing')} on something"]
    parts.append(f"{plural(len(signals.attempts) - len(signals.grasps), 'closing')} on nothing")
    if signals.freeze is not None:
        parts.append(f"rest from {signals.freeze.start_s:.1f} s to the end")
    if signals.to_and_fro is not None:
        parts.append(f"motion back and forth from {signals.to_and_fro.start_s:.1f} s")
    if signals.repeated is not None:
        parts.append(f"{plural(signals.repeated.count, 'approach', 'approaches')} to one place without an object")
    return f"Joint states show {listed(parts)}."
