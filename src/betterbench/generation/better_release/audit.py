"""Audit of a task of the BeTTER release.

The audit finds violations of kinematic isolation, i.e. picks and placements that a test requires but training does not
contain. It also finds instructions that do not match their scene. All distances are measured between the poses in the
release, before positions are transferred to our table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal

from betterbench.generation.better_release.building import Built
from betterbench.generation.better_release.files import ReleaseTask
from betterbench.generation.better_release.layout import SAME_SLOT_M, beyond_workspace_m
from betterbench.generation.better_release.matching import Match
from betterbench.generation.better_release.predicates import holds_at_start
from betterbench.generation.better_release.resolved import GROUPS, Resolved, left_behind
from betterbench.generation.better_release.sentence import Lexicon, Named, Sentence, color_of
from betterbench.geometry import normalize, yaw_of
from betterbench.sim.assets import colors

Level = Literal["fault", "remark"]

CODES: Mapping[str, str] = {
    "pick_outside_support": "An object is picked at a position where no training variation has a goal object.",
    "pick_not_trained": "No training variation has this object as a goal.",
    "place_outside_support": "The target is at an untrained position, or is another object than in training.",
    "replaced_but_left": "An object was replaced, but it is still in the scene.",
    "in_no_group": "An object is in the scene, but in no group: no rule covers it.",
    "names_absent": "The instruction names an object that is not in the scene.",
    "names_no_goal": "The instruction asks for an object that is not a goal.",
    "names_more": "The instruction covers an object that is not a goal.",
    "goal_not_named": "The instruction does not name a goal object.",
    "other_target": "The instruction names another target than the goals.",
    "undecided": "The instruction cannot be compared with the goals.",
    "same_input_other_goals": "Two variations have the same scene and instruction, but different goals.",
    "no_fail_predicate": "The list of fail predicates is empty: any object may be moved anywhere.",
    "fail_predicates_removed": "Fail predicates that follow from the groups are removed.",
    "absent_id": "An id is not among the objects of the task.",
    "no_pose": "An object of a group has no pose; the release refuses such a scene.",
    "no_candidate": "An object has no asset; the release refuses such a scene.",
    "other_asset": "The selected asset is not among the candidates of the object.",
    "two_groups": "An object is in two groups.",
    "no_goal": "The goal group is empty: the episode succeeds at once.",
    "met_at_start": "A success predicate holds at the start.",
    "fails_at_start": "A fail predicate holds at the start.",
    "overlap": "Two objects overlap at the start.",
    "outside_our_table": "A position is outside the reach or the camera view of our setup.",
    "group_size": "A group has another number of objects than its template allows.",
    "no_effect": "A change removes a predicate or a member that does not exist.",
    "no_change": "A test variation does not differ from a training variation.",
    "template_boolean": "The template writes a relation without quotes, which YAML reads as a boolean.",
    "disabled": "The release has disabled the variation.",
    "not_represented": "The variation cannot be represented in our form.",
    "left_out": "An object of the scene is left out in our form.",
    "no_counterpart": "A predicate has no counterpart in our relations.",
    "hidden": "In our scene, the target hides a goal object from the front camera.",
    "stand_in": "An object is represented by an asset with another name.",
    "other_color": "An object is represented by an asset that does not have its color.",
}
"""Meaning of each finding code."""

REMARKS = frozenset(
    (
        *("in_no_group", "undecided", "fail_predicates_removed", "outside_our_table", "group_size", "no_effect"),
        *(
            "template_boolean",
            "disabled",
            "not_represented",
            "left_out",
            "no_counterpart",
            "hidden",
            "stand_in",
            "other_color",
        ),
    )
)
"""Codes of findings that are only remarks on the import, the file format or undecided cases.

All other codes are faults of the task.
"""

_SAME_POSE_M = 0.005
_FOUND_BY = {"search": "found by its words", "class": "found by its class", "given": "given"}


@dataclass(frozen=True)
class Finding:
    """A finding of the audit about one variation or the complete task.

    Attributes:
        variation: Id of the variation, or "" for a finding about the complete task.
        code: Kind of finding, a key of :data:`CODES`.
        text: Description of the finding in one sentence.
        numbers: Measured values by name. Each name ends with its unit ("nearest_own_cm").
        objects: Ids of the objects that the finding is about.
    """

    variation: str
    code: str
    text: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    objects: tuple[str, ...] = ()

    @property
    def level(self) -> Level:
        """Whether the finding is a fault of the task or only a remark."""
        return "remark" if self.code in REMARKS else "fault"

    def to_json(self) -> dict[str, Any]:
        """Return the finding as a JSON object."""
        return {
            "variation": self.variation,
            "code": self.code,
            "level": self.level,
            "text": self.text,
            "numbers": {name: round(value, 2) for name, value in self.numbers.items()},
            "objects": list(self.objects),
        }


@dataclass(frozen=True)
class Audit:
    """All findings about a task. Findings about the complete task come before those about single variations."""

    task: str
    findings: tuple[Finding, ...]

    def of(self, variation: str) -> tuple[Finding, ...]:
        """Return the findings about one variation, or about the complete task if ``variation`` is ""."""
        return tuple(f for f in self.findings if f.variation == variation)

    @property
    def faults(self) -> tuple[Finding, ...]:
        """Findings that are faults of the task."""
        return tuple(f for f in self.findings if f.level == "fault")


def audit_release(
    task: ReleaseTask, resolved: Mapping[str, Resolved], matches: Mapping[str, Match], built: Built
) -> Audit:
    """Audit a task of the BeTTER release.

    Args:
        task: Task as written in its files.
        resolved: Variations of the task, including inherited values.
        matches: Library asset that represents each object. The size of the asset is used for the object, because the
            release does not state sizes.
        built: The same task converted to our task format.
    """
    auditor = _Auditor(task, resolved, matches, built)
    return Audit(task.task.task_id, tuple(auditor.findings()))


class _Auditor:
    """Collects the findings about a task, with one method per group of checks."""

    def __init__(
        self, task: ReleaseTask, resolved: Mapping[str, Resolved], matches: Mapping[str, Match], built: Built
    ) -> None:
        self.task, self.resolved, self.matches, self.built = task, resolved, matches, built
        self.lexicon = Lexicon(task)
        self.training = [v for v in resolved.values() if v.training and v.enabled]
        self.sizes = {name: match.asset.size_m for name, match in matches.items()}

    def findings(self) -> Iterator[Finding]:
        yield from self._of_task()
        for variation in self.resolved.values():
            for check in _CHECKS:
                yield from check(self, variation)

    def noun(self, name: str) -> str:
        """Describe an object by its noun and its id."""
        return f"{self.lexicon.noun(name)} ({name})" if name in self.task.instances else name

    def _of_task(self) -> Iterator[Finding]:
        if self.task.template is not None and self.task.template.booleans:
            where = ", ".join(self.task.template.booleans)
            text = f"The template {self.task.template.template_id} has booleans at {where}; the release ignores them."
            yield Finding("", "template_boolean", text, {"booleans": len(self.task.template.booleans)})
        for name, match in self.matches.items():
            if match.is_stand_in:
                text = f"The {self.noun(name)} is represented by the category {match.category}"
                text += f" ({_FOUND_BY[match.how]}, score {match.score:.2f})."
                yield Finding("", "stand_in", text, {"score": match.score}, (name,))
            color = color_of(self.task.instances[name])
            if color is not None and color not in colors(match.category):
                text = f"The {self.noun(name)} is {color} in the release; our {match.category} has no such color."
                yield Finding("", "other_color", text, {"colors": len(colors(match.category))}, (name,))

    # --------------------------------------------------------------------------------------------- content of the files

    def files(self, variation: Resolved) -> Iterator[Finding]:
        """Check that the ids, groups, poses, candidate assets and goals in the files are complete and consistent."""
        known = self.task.instances
        mentioned = {name: "a group" for group in GROUPS for name in variation.groups[group]}
        mentioned |= {p.subject_id: "a predicate" for p in (*variation.success, *variation.fail)}
        mentioned |= {p.target_id: "a predicate" for p in (*variation.success, *variation.fail)}
        mentioned |= dict.fromkeys(variation.poses, "a pose")
        mentioned |= {variation.container: "the container"}
        for name, where in sorted(mentioned.items()):
            if name not in known:
                text = f"{name} is named as {where}, but object_universe.yaml does not list it."
                yield Finding(variation.name, "absent_id", text, {}, (name,))
        for name in variation.active:
            if name in known and name not in variation.poses:
                text = f"The {self.noun(name)} is in the scene without a pose."
                yield Finding(variation.name, "no_pose", text, {}, (name,))
            candidates = (self.task.candidates or {}).get(name, ())
            if self.task.candidates is not None and name in known and not candidates:
                text = f"The {self.noun(name)} has no candidate in asset_bindings.yaml."
                yield Finding(variation.name, "no_candidate", text, {"candidates": 0}, (name,))
            pose = variation.poses.get(name)
            if pose is not None and pose.selected_asset_id and candidates and pose.selected_asset_id not in candidates:
                text = f"The {self.noun(name)} selects {pose.selected_asset_id}, which is not a candidate."
                yield Finding(variation.name, "other_asset", text, {"candidates": len(candidates)}, (name,))
        for one, other in combinations(GROUPS, 2):
            for name in sorted(set(variation.groups[one]) & set(variation.groups[other])):
                text = f"The {self.noun(name)} is in the {one} group and in the {other} group."
                yield Finding(variation.name, "two_groups", text, {}, (name,))
        if not variation.success:
            yield Finding(variation.name, "no_goal", "There is no success predicate.", {"success_predicates": 0})
        if not variation.enabled:
            yield Finding(variation.name, "disabled", "The field `enabled` is false.")

    def changes(self, variation: Resolved) -> Iterator[Finding]:
        """Check that each change in a variation has an effect, and that the variation's groups match the template."""
        written = self.task.variations[variation.name]
        base = self.resolved_base()
        for group in GROUPS:
            for name in getattr(written, f"remove_{group}_objects"):
                added = {*base.get(group, ()), *getattr(written, f"add_{group}_objects")}
                given = getattr(written, f"set_{group}_objects")
                if name not in (added if given is None else {*given, *added}):
                    text = f"It removes {name} from the {group} group, which does not contain it."
                    yield Finding(variation.name, "no_effect", text, {}, (name,))
        fails = self.task.task.defaults.fail_policy.fail_on_relations
        derived = {(n, r, variation.container) for n in variation.groups["fail"] for r in fails}
        appended = {(p.subject_id, p.relation, p.target_id) for p in written.policy_overrides.fail.append}
        for predicate in written.policy_overrides.fail.remove:
            if (predicate.subject_id, predicate.relation, predicate.target_id) not in derived | appended:
                text = f"It removes the fail predicate {predicate}, which does not exist."
                yield Finding(variation.name, "no_effect", text, {}, (predicate.subject_id,))
        if self.task.template is not None:
            hints = {"target": "goal", "distractor": "fail", "decor": "decor"}
            for slot in self.task.template.slots:
                hint = hints.get(slot.group_hint)
                count = 1 if hint is None else len(variation.groups[hint])
                if not slot.min_count <= count <= slot.max_count:
                    text = f"The group {slot.group_hint} has {count} objects; the template allows "
                    text += f"{slot.min_count} to {slot.max_count}."
                    numbers = {"objects": count, "least": slot.min_count, "most": slot.max_count}
                    yield Finding(variation.name, "group_size", text, numbers)

    def resolved_base(self) -> Mapping[str, tuple[str, ...]]:
        """Return the members of each group in the base variation."""
        base = self.task.base
        return {
            group: (*(getattr(base, f"set_{group}_objects") or ()), *getattr(base, f"add_{group}_objects"))
            for group in GROUPS
        }

    # ------------------------------------------------------------------------------------------------------- the rules

    def rules(self, variation: Resolved) -> Iterator[Finding]:
        """Find missing fail predicates, and success or fail predicates that already hold in the initial scene."""
        movable = [n for n in variation.active if n not in variation.goals and n != variation.container]
        derived = len(variation.groups["fail"]) * len(self.task.task.defaults.fail_policy.fail_on_relations)
        numbers = {"fail_predicates": len(variation.fail), "objects_without_rule": len(movable)}
        if not variation.fail:
            kinds = ", ".join(self.lexicon.noun(n) for n in movable if n in self.task.instances)
            text = f"None of the {derived} fail predicates is left: each of the {len(movable)} other objects"
            text += f" ({kinds}) may go to the target." if kinds else " may go to the target."
            yield Finding(variation.name, "no_fail_predicate", text, numbers, tuple(movable))
        elif len(variation.fail) < derived:
            text = f"{derived - len(variation.fail)} of {derived} fail predicates are removed."
            yield Finding(variation.name, "fail_predicates_removed", text, {**numbers, "derived": derived})
        for code, predicates in (("met_at_start", variation.success), ("fails_at_start", variation.fail)):
            for predicate in predicates:
                if holds_at_start(predicate, variation.poses, self.sizes):
                    apart = self._apart_cm(variation, predicate.subject_id, predicate.target_id)
                    text = f"{predicate} holds at the start: the centers are {apart:.1f} cm apart."
                    objects = (predicate.subject_id, predicate.target_id)
                    yield Finding(variation.name, code, text, {"apart_cm": apart}, objects)

    def _apart_cm(self, variation: Resolved, a: str, b: str) -> float:
        return 100.0 * math.dist(variation.poses[a].position[:2], variation.poses[b].position[:2])

    # ------------------------------------------------------------------------------------------------------- the scene

    def scene(self, variation: Resolved) -> Iterator[Finding]:
        """Check whether each object belongs to a group, and whether objects overlap or lie outside the workspace."""
        left = left_behind(variation, self.training)
        for one in left:
            cm = 100.0 * one.distance_m
            text = f"The {self.noun(one.name)} is in no group, but still in the scene, {cm:.1f} cm from the "
            text += f"{self.noun(one.by)} that replaces it."
            yield Finding(variation.name, "replaced_but_left", text, {"apart_cm": cm}, (one.name, one.by))
        grouped = {n for members in variation.groups.values() for n in members} | {variation.container}
        for name in sorted(set(variation.poses) - grouped - {one.name for one in left}):
            text = f"The {self.noun(name)} is in the scene, but in no group."
            yield Finding(variation.name, "in_no_group", text, {}, (name,))
        there = [n for n in variation.active if n in variation.poses and n in self.sizes and n != variation.container]
        for a, b in combinations(there, 2):
            apart = self._apart_cm(variation, a, b)
            needed = 50.0 * (min(self.sizes[a][:2]) + min(self.sizes[b][:2]))
            if apart < needed:
                text = (
                    f"The {self.noun(a)} and the {self.noun(b)} are {apart:.1f} cm apart; with the sizes of our assets "
                )
                text += f"they need {needed:.1f} cm."
                numbers = {"apart_cm": apart, "needed_cm": needed, "overlap_cm": needed - apart}
                yield Finding(variation.name, "overlap", text, numbers, (a, b))
        for name in variation.active:
            place = variation.xy(name)
            beyond = 0.0 if place is None else 100.0 * beyond_workspace_m(*place)
            if place is not None and beyond > 0.5:
                slot = self.built.slots.of.get((variation.name, name))
                moved = 100.0 * self.built.slots.moved_m[slot] if slot is not None else 0.0
                text = f"The {self.noun(name)} at ({place[0]:.3f}, {place[1]:.3f}) m is {beyond:.1f} cm outside "
                text += f"our table's reach and view; its slot is moved by {moved:.1f} cm."
                numbers = {"outside_cm": beyond, "moved_cm": moved}
                yield Finding(variation.name, "outside_our_table", text, numbers, (name,))

    # ------------------------------------------------------------------------------------------------- training support

    def support(self, variation: Resolved) -> Iterator[Finding]:
        """Compare the picks and placements of a test variation with the picks and placements in training."""
        if variation.training or not variation.enabled:
            return
        picks = [(other, name) for other in self.training for name in other.goals if name in other.poses]
        for name in variation.goals:
            place = variation.xy(name)
            if place is None:
                continue
            own = [100.0 * math.dist(place, o.poses[n].position[:2]) for o, n in picks if n == name]
            if not own:
                text = f"No training variation has the {self.noun(name)} as a goal."
                yield Finding(variation.name, "pick_not_trained", text, {"training_picks": 0}, (name,))
            distances = [(100.0 * math.dist(place, o.poses[n].position[:2]), o.name, n) for o, n in picks]
            nearest, where, which = min(distances, default=(math.inf, "", ""))
            if nearest > 100.0 * SAME_SLOT_M:
                text = f"The {self.noun(name)} is picked {nearest:.1f} cm from the nearest pick of training "
                text += f"({self.lexicon.noun(which)} in {where})" if which in self.task.instances else "(none)"
                text += f" and {min(own):.1f} cm from its own nearest one." if own else "."
                numbers = {"nearest_any_cm": nearest} | ({"nearest_own_cm": min(own)} if own else {})
                yield Finding(variation.name, "pick_outside_support", text, numbers, (name,))
            elif own and (turned := self._turned_deg(variation, name)) > 30.0:
                text = f"The {self.noun(name)} is turned by {turned:.0f} degrees from every training variation."
                yield Finding(variation.name, "pick_outside_support", text, {"turned_deg": turned}, (name,))
        yield from self._placements(variation)

    def _turned_deg(self, variation: Resolved, name: str) -> float:
        """Return the smallest angle between an object's heading and the headings that it has in training [degrees].

        The angle is 0 for a round object.
        """
        match = self.matches.get(name)
        if match is not None and not match.is_stand_in and match.asset.shape in ("round", "cylinder"):
            return 0.0
        yaw = yaw_of(normalize(variation.poses[name].rotation))
        yaws = [yaw_of(normalize(o.poses[name].rotation)) for o in self.training if name in o.poses]
        return min((math.degrees(abs(math.remainder(yaw - other, math.tau))) for other in yaws), default=0.0)

    def _placements(self, variation: Resolved) -> Iterator[Finding]:
        trained = {(p.relation, p.target_id) for other in self.training for p in other.success}
        for relation, target in sorted({(p.relation, p.target_id) for p in variation.success}):
            place = variation.xy(target)
            if (relation, target) not in trained:
                text = f"No training variation puts an object {relation} the {self.noun(target)}."
                yield Finding(variation.name, "place_outside_support", text, {"training_placements": 0}, (target,))
            elif place is not None:
                places = [o.xy(target) for o in self.training]
                nearest = min(100.0 * math.dist(place, other) for other in places if other is not None)
                if nearest > 100.0 * SAME_SLOT_M:
                    text = f"The {self.noun(target)} stands {nearest:.1f} cm from its nearest training position."
                    yield Finding(variation.name, "place_outside_support", text, {"nearest_cm": nearest}, (target,))

    # -------------------------------------------------------------------------------------------------- the instruction

    def instruction(self, variation: Resolved) -> Iterator[Finding]:
        """Compare the instruction with the goals and with the scene."""
        sentence = self.lexicon.parse(variation.instruction)
        there = {name for name in variation.active if name in variation.poses}
        if any("change the meaning" in reason or "verb" in reason for reason in sentence.undecided):
            yield self._open(variation, sentence.undecided)
            return
        asked = [noun for noun in sentence.nouns if not noun.is_target]
        for noun in asked:
            yield from self._asked(variation, noun, there)
        yield from self._targets(variation, sentence, there)
        named = {name for noun in sentence.nouns for name in noun.objects}
        unnamed = [name for name in variation.goals if name in there and name not in named]
        open_nouns = [noun.text for noun in asked if noun.is_class] if unnamed else []
        reasons = (*sentence.undecided, *(f"{text!r} may include other goals" for text in open_nouns))
        if reasons:
            yield self._open(variation, reasons)
        for name in () if reasons else unnamed:
            text = f"“{variation.instruction}” does not name the {self.noun(name)}, which is a goal."
            yield Finding(variation.name, "goal_not_named", text, {}, (name,))

    def _open(self, variation: Resolved, reasons: Iterable[str]) -> Finding:
        text = f"“{variation.instruction}” is undecided: {'; '.join(reasons)}."
        return Finding(variation.name, "undecided", text)

    def _asked(self, variation: Resolved, noun: Named, there: set[str]) -> Iterator[Finding]:
        goals, targets = set(variation.goals), {p.target_id for p in variation.success}
        present = [name for name in noun.objects if name in there and name not in targets]
        wanted = [name for name in present if name in goals]
        shown = ", ".join(self.lexicon.noun(name) for name in variation.goals if name in self.task.instances)
        said = f"“{variation.instruction}” asks for the {noun.text}"
        if not present and not set(noun.objects) & targets:
            text = f"{said}, and the scene has none; the goals are: {shown}."
            yield Finding(variation.name, "names_absent", text, {"objects": 0}, noun.objects)
        elif present and not wanted:
            text = f"{said}, which is not a goal; the goals are: {shown}."
            yield Finding(variation.name, "names_no_goal", text, {"goals": len(goals)}, tuple(present))
        elif noun.every and len(wanted) < len(present):
            more = [name for name in present if name not in goals]
            kinds = " and ".join(self._with_group(variation, name) for name in more)
            text = f"“{variation.instruction}” covers every {noun.text}, including {kinds}; the goals are: {shown}."
            numbers = {"covered": len(present), "goals": len(wanted)}
            yield Finding(variation.name, "names_more", text, numbers, tuple(more))
        elif len(wanted) < len(present):
            text = f"{said} is undecided: it fits {len(present)} objects, of which {len(wanted)} are goals."
            numbers = {"covered": len(present), "goals": len(wanted)}
            yield Finding(variation.name, "undecided", text, numbers, tuple(present))

    def _with_group(self, variation: Resolved, name: str) -> str:
        group = next((g for g in GROUPS if name in variation.groups[g]), None)
        where = "no group" if group is None else f"{group} group"
        return f"the {self.lexicon.noun(name)} ({name}, {where})"

    def _targets(self, variation: Resolved, sentence: Sentence, there: set[str]) -> Iterator[Finding]:
        goals, targets = set(variation.goals), {p.target_id for p in variation.success}
        places = [noun for noun in sentence.nouns if noun.is_target]
        if places and targets and not any(targets & set(noun.objects) or goals & set(noun.objects) for noun in places):
            nouns = ", ".join(noun.text for noun in places)
            kinds = ", ".join(self.noun(name) for name in sorted(targets))
            absent = not any(there & set(noun.objects) for noun in places)
            text = f"“{variation.instruction}” names the {nouns}{', which is not there,' if absent else ''} as the "
            text += f"target; the goals have the {kinds}."
            yield Finding(variation.name, "other_target", text, {}, tuple(sorted(targets)))

    def twins(self, variation: Resolved) -> Iterator[Finding]:
        """Find earlier variations that have the same scene and the same instruction as a given variation.

        Such a variation is reported if its goals differ from the goals of the given variation, or if a training
        variation is the same as a test variation.
        """
        for other in self.resolved.values():
            if other.name == variation.name:
                return
            if variation.instruction != other.instruction or set(variation.poses) != set(other.poses):
                continue
            moved = [math.dist(variation.poses[n].position, other.poses[n].position) for n in variation.poses]
            if max(moved, default=0.0) > _SAME_POSE_M:
                continue
            numbers = {"largest_shift_cm": 100.0 * max(moved, default=0.0)}
            if set(variation.success) != set(other.success):
                differ = sorted({*variation.goals} ^ {*other.goals})
                kinds = ", ".join(self.noun(name) for name in differ)
                text = (
                    f"Scene and instruction are those of {other.name}, but the goals differ in: {kinds or 'relations'}."
                )
                yield Finding(variation.name, "same_input_other_goals", text, numbers, tuple(differ))
            elif other.training and not variation.training:
                text = f"Scene, instruction and goals are those of {other.name}."
                yield Finding(variation.name, "no_change", text, numbers)

    # --------------------------------------------------------------------------------------------------- our own form

    def form(self, variation: Resolved) -> Iterator[Finding]:
        """List the parts of a variation that could not be converted to our task format."""
        shown = self.built.variations[variation.name]
        if shown.name is None and variation.enabled:
            yield Finding(variation.name, "not_represented", f"{'; '.join(shown.reasons)}.".capitalize())
        for name in variation.goals:
            if shown.name is not None and (variation.name, name) in self.built.slots.hidden:
                text = f"The {self.noun(variation.container)} hides the {self.noun(name)} from our front camera."
                yield Finding(variation.name, "hidden", text, {}, (name, variation.container))
        for name, reason in shown.left_out.items():
            yield Finding(variation.name, "left_out", f"The {self.noun(name)} is left out: {reason}.", {}, (name,))
        for predicate in shown.predicates:
            text = f"{predicate} has no counterpart."
            yield Finding(variation.name, "no_counterpart", text, {}, (predicate.subject_id, predicate.target_id))


_CHECKS: tuple[Callable[[_Auditor, Resolved], Iterator[Finding]], ...] = (
    _Auditor.files,
    _Auditor.changes,
    _Auditor.rules,
    _Auditor.scene,
    _Auditor.support,
    _Auditor.instruction,
    _Auditor.twins,
    _Auditor.form,
)
