"""The shortcut audit: what goes together in a dataset beyond chance, and which variations take it apart."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.interventions import resolve_condition
from betterbench.shortcuts.association import Association, association, strongest_of
from betterbench.shortcuts.facts import EpisodeFacts, facts_of_condition
from betterbench.shortcuts.questions import (
    COUNT,
    FIRST_PLACE,
    LANDMARK,
    QUESTIONS,
    WORD_OUTCOMES,
    Question,
    handled_kinds,
)
from betterbench.tasks import get_task, task_names

ALPHA = 0.05
"""Level of the tests, over all questions of an audit together (Bonferroni)."""
STRONG = 0.5
"""Strength from which a finding counts: half of what could be known of one thing follows from the other. A finding also
counts if one value alone, such as a single word, always goes with the same other value."""
RARE = 0.05
"""Share below which something counts as not shown by the data."""
FEWEST = 8
"""Fewest demonstrations of a group for which anything is said."""
MOST_LINES = 8

Verdict = Literal["shortcut", "regularity", "none"]
"""What was found: a rule that some variation breaks, or a stranger's test could; one that every variation of the task
keeps, such as what a word means; or nothing beyond chance and :data:`STRONG`."""

Rules = Mapping[str, Counter[str]]
"""Per first value how often each second value was seen with it."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What the data say to one question.

    Attributes:
        question: Name of the question.
        title: What was asked.
        subject: The word that it is about, "" for questions about all things.
        bits: Mutual information [bit].
        strength: 0 to 1, see :class:`~betterbench.shortcuts.association.Association`.
        p_value: Of the permutation test; None where there is nothing to permute.
        p_adjusted: The same, times the number of questions of the audit.
        n: Observations.
        verdict: What follows.
        rules: What a learner could go by, for people.
        seen: The same as counts: how often each second value was seen with each first one.
        separating: Variations whose right behavior breaks the rule, with the observation that does.
    """

    question: str
    title: str
    subject: str
    bits: float
    strength: float
    p_value: float | None
    p_adjusted: float | None
    n: int
    verdict: Verdict
    rules: tuple[str, ...]
    seen: Mapping[str, Mapping[str, int]]
    separating: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class GroupAudit:
    """The findings on one task, or on one stranger's dataset."""

    group: str
    episodes: int
    findings: tuple[Finding, ...]

    def of(self, question: str) -> tuple[Finding, ...]:
        """Return the findings to a question."""
        return tuple(f for f in self.findings if f.question == question)

    @property
    def shortcuts(self) -> tuple[Finding, ...]:
        """What a learner could go by and some variation breaks."""
        return tuple(f for f in self.findings if f.verdict == "shortcut")


@dataclass(frozen=True, slots=True)
class ShortcutAudit:
    """The audit of a dataset.

    Attributes:
        source: What was audited.
        facts_sha256: Hash of the facts that it rests on.
        groups: One per task.
    """

    source: str
    facts_sha256: str
    groups: tuple[GroupAudit, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {**asdict(self), "alpha": ALPHA, "strong": STRONG}


def facts_hash(episodes: Sequence[EpisodeFacts]) -> str:
    """Return the SHA-256 over all facts, whatever their order."""
    lines = sorted(repr(facts) for facts in episodes)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def audit_dataset(source: str, episodes: Sequence[EpisodeFacts]) -> ShortcutAudit:
    """Return what goes together in a dataset; a function of the facts alone.

    Raises InvalidInputError if there is no group with enough demonstrations.
    """
    groups: dict[str, list[EpisodeFacts]] = {}
    for facts in sorted(episodes, key=lambda f: (f.group, f.episode)):
        groups.setdefault(facts.group, []).append(facts)
    audited = [_audit_group(name, found) for name, found in groups.items() if len(found) >= FEWEST]
    if not audited:
        most = max(map(len, groups.values()), default=0)
        problem = f"the largest group has {most} demonstrations, and {FEWEST} are needed to say anything"
        raise InvalidInputError(source, problem, "Give more demonstrations")
    return ShortcutAudit(source, facts_hash(episodes), tuple(_judged(audited)))


@dataclass(frozen=True, slots=True)
class _Raw:
    """A finding before the correction, with the rules that it rests on."""

    finding: Finding
    rules: Rules


def _audit_group(name: str, episodes: Sequence[EpisodeFacts]) -> tuple[str, Sequence[EpisodeFacts], list[_Raw]]:
    handled = handled_kinds(episodes)
    raw = [found for q in QUESTIONS if (found := _answer(name, q, episodes, handled)) is not None]
    raw += [found for q in WORD_OUTCOMES for found in _answers_about_words(name, q, episodes)]
    raw += _constants(episodes)
    return name, episodes, raw


def _draw(group: str, question: str) -> np.random.Generator:
    digest = hashlib.sha256(f"shortcuts|{group}|{question}".encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))


def _answer(name: str, q: Question, episodes: Sequence[EpisodeFacts], handled: frozenset[str]) -> _Raw | None:
    """Return what a question about named things found, or None where there is nothing to ask."""
    seen = [pair for facts in episodes for pair in q.pairs(facts, handled)]
    if len({x for _, x, _ in seen}) < 2 or len({y for _, _, y in seen}) < 2:
        return None
    found = association(
        [x for _, x, _ in seen],
        [y for _, _, y in seen],
        _draw(name, q.name),
        blocks=[block for block, _, _ in seen],
        within=q.within,
    )
    rules: dict[str, Counter[str]] = {}
    for _, x, y in seen:
        rules.setdefault(x, Counter())[y] += 1
    lines = [q.rule.format(x=x, y=_shares(ys)) for x, ys in sorted(rules.items())]
    if q.name == "order":
        lines = [line for line in lines if not line.endswith("later")]
    return _Raw(_finding(q.name, q.title, "", found, lines), rules)


def _answers_about_words(name: str, question: str, episodes: Sequence[EpisodeFacts]) -> list[_Raw]:
    """Return what each word of the instructions says about one outcome; words that always go together are one."""
    title, wording, outcome = WORD_OUTCOMES[question]
    known = [facts for facts in episodes if outcome(facts)]
    alike: dict[frozenset[str], list[str]] = {}
    for word in sorted({word for facts in known for word in facts.words}):
        alike.setdefault(frozenset(f.episode for f in known if word in f.words), []).append(word)
    told = [(" ".join(words), has) for has, words in alike.items() if 2 <= len(has) <= len(known) - 2]
    outcomes = [outcome(facts) for facts in known]
    if not told or len(set(outcomes)) < 2:
        return []
    presence = np.array([[facts.episode in has for _, has in told] for facts in known])
    raw = []
    for (words, has), found in zip(told, strongest_of(presence, outcomes, _draw(name, question)), strict=True):
        seen = Counter(outcome(facts) for facts in known if facts.episode in has)
        shown = " ".join(words.split()[:6])
        line = f"with “{shown}”, {wording.format(y=_shares(seen))}"
        raw.append(_Raw(_finding(question, title, shown, found, [line]), {words: seen}))
    return raw


def _constants(episodes: Sequence[EpisodeFacts]) -> list[_Raw]:
    """Return what never differs: where a landmark stands, how many things there are, or the first place of all."""
    raw = []
    slots: dict[str, Counter[str]] = {}
    for facts in episodes:
        for kind, slot in facts.landmarks:
            slots.setdefault(kind, Counter())[slot] += 1
    for kind, found in sorted(slots.items()):
        if len(found) == 1:
            line = f"{kind} always stands at {next(iter(found))}"
            raw.append(_constant(LANDMARK, "place of the target", kind, line, {kind: found}))
    counts = Counter(str(len(f.standing)) for f in episodes if f.privileged)
    if len(counts) == 1:
        line = f"{next(iter(counts))} loose things stand on the table at the start"
        raw.append(_constant(COUNT, "number of things at the start", "", line, {"": counts}))
    places = Counter(f.steps[0].origin for f in episodes if not f.privileged and f.steps)
    if len(places) == 1 and len({f.instruction for f in episodes}) > 1:
        line = f"whatever is asked for, the gripper first closes at {next(iter(places))}"
        raw.append(_constant(FIRST_PLACE, "first place", "", line, {"": places}))
    return raw


def _constant(question: str, title: str, subject: str, line: str, rules: Rules) -> _Raw:
    n = sum(sum(found.values()) for found in rules.values())
    return _Raw(Finding(question, title, subject, 0.0, 1.0, None, None, n, "none", (line,), {}, ()), rules)


def _finding(question: str, title: str, subject: str, found: Association, lines: Sequence[str]) -> Finding:
    more = len(lines) - MOST_LINES
    shown = (*lines[:MOST_LINES], *([f"and {more} more"] if more > 0 else []))
    return Finding(
        question, title, subject, found.bits, found.strength, found.p_value, None, found.n, "none", shown, {}, ()
    )


def _shares(seen: Counter[str]) -> str:
    """Return the values with their shares, the most frequent first."""
    total = sum(seen.values())
    ranked = sorted(seen.items(), key=lambda item: (-item[1], item[0]))
    if len(ranked) == 1:
        return ranked[0][0]
    listed = [f"{value} ({100.0 * count / total:.0f} %)" for value, count in ranked[:3]]
    return ", ".join(listed) + (f" and {len(ranked) - 3} more" if len(ranked) > 3 else "")


def _judged(groups: Sequence[tuple[str, Sequence[EpisodeFacts], list[_Raw]]]) -> list[GroupAudit]:
    """Correct the p-values of all groups together, and give the verdicts."""
    questions = len({(name, r.finding.question) for name, _, found in groups for r in found if r.finding.p_value})
    judged = []
    for name, episodes, found in groups:
        tests = _tests_of(name)
        findings = []
        for raw in found:
            p = raw.finding.p_value
            adjusted = None if p is None else round(min(1.0, p * questions), 6)
            seen = {x: dict(sorted(ys.items())) for x, ys in sorted(raw.rules.items())}
            findings.append(_verdict(replace(raw.finding, p_adjusted=adjusted, seen=seen), raw.rules, tests))
        judged.append(GroupAudit(name, len(episodes), tuple(findings)))
    return judged


def _tests_of(group: str) -> dict[str, EpisodeFacts] | None:
    """Return what a right policy does in each variation of a task; None if it is no task of ours."""
    if group not in task_names():
        return None
    names = [variation.name for variation in get_task(group).variations]
    return {name: facts_of_condition(resolve_condition(group, name).condition) for name in names}


def _verdict(finding: Finding, rules: Rules, tests: Mapping[str, EpisodeFacts] | None) -> Finding:
    sure = finding.p_adjusted is None or finding.p_adjusted <= ALPHA
    if not sure or (finding.strength < STRONG and not _certain(rules)):
        return finding
    if tests is None:
        return replace(finding, verdict="shortcut")
    broken = [(name, why) for name, facts in tests.items() if (why := _breaks(finding, rules, facts))]
    return replace(finding, verdict="shortcut" if broken else "regularity", separating=tuple(broken))


def _certain(rules: Rules) -> bool:
    """Tell whether some value always goes with the same other one, of several that there are."""
    if len({y for ys in rules.values() for y in ys}) < 2:
        return False
    return any(len(ys) == 1 and sum(ys.values()) >= FEWEST for ys in rules.values())


def _breaks(finding: Finding, rules: Rules, test: EpisodeFacts) -> str:
    """Return what of a test does not go by a rule, or "" if all of it does."""
    if finding.question == COUNT:
        there = str(len(test.standing))
        things = "thing" if there == "1" else "things"
        return "" if there in rules[""] else f"{there} loose {things} at the start"
    if finding.question == LANDMARK:
        moved = [slot for kind, slot in test.landmarks if kind in rules and slot not in rules[kind]]
        return f"{finding.subject} stands at {moved[0]}" if moved else ""
    if finding.question in WORD_OUTCOMES:
        return _breaks_words(finding.question, rules, test)
    question = next(q for q in QUESTIONS if q.name == finding.question)
    back: dict[str, Counter[str]] = {}
    for x, ys in rules.items():
        for y, count in ys.items():
            back.setdefault(y, Counter())[x] += count
    for _, x, y in question.pairs(test, None):
        if (x in rules and _is_rare(rules[x], y)) or (question.either_way and y in back and _is_rare(back[y], x)):
            return question.rule.format(x=x, y=y)
    return ""


def _breaks_words(question: str, rules: Rules, test: EpisodeFacts) -> str:
    words, seen = next(iter(rules.items()))
    _, wording, outcome = WORD_OUTCOMES[question]
    there = outcome(test)
    if not there or not set(words.split()) & test.words or not _is_rare(seen, there):
        return ""
    return wording.format(y=there)


def _is_rare(seen: Counter[str], value: str) -> bool:
    return seen[value] < RARE * sum(seen.values())
