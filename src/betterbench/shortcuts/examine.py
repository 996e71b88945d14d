"""The shortcut audit: what goes together in a dataset beyond chance, and which variations take it apart."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from betterbench.errors import InvalidInputError
from betterbench.interventions import resolve_condition
from betterbench.shortcuts.association import (
    Association,
    codes_of,
    entropy_bits,
    features_test,
    permutation_test,
)
from betterbench.shortcuts.facts import EpisodeFacts, facts_of_condition
from betterbench.shortcuts.pairs import WordPair, least_share, telling_pairs
from betterbench.shortcuts.questions import (
    COUNT,
    FIRST_PLACE,
    LANDMARK,
    QUESTIONS,
    WORD_OUTCOMES,
    Question,
    handled_kinds,
)
from betterbench.shortcuts.reading import DataReading
from betterbench.shortcuts.smallest import (
    POWER,
    STEPS,
    Planted,
    RuleCounts,
    SmallestRule,
    planted_question,
    planted_word,
    smallest_rule,
)
from betterbench.shortcuts.words import instruction_words, is_spaced, overlapping, shown_as, without_joined
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
NEARLY_ALWAYS = 0.9
"""Share of what is open about an outcome that a word tells where it is said, from which it counts as a sure sign."""
MOST_LINES = 8
MOST_WORDS = 1000
"""Most words of a group that are asked about: those that the most episodes tell apart."""
MOST_PAIRS = 20
PAIRS = "_together"
"""What follows the name of a question about words in that about pairs of them."""

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
    """The findings on one task, or on one stranger's dataset.

    Attributes:
        group: Name of the task or of the dataset.
        episodes: Demonstrations, or segments of some.
        findings: What was found.
        notes: What could not be asked, and why.
        smallest: Per question the smallest rule that would have been found with so many demonstrations.
    """

    group: str
    episodes: int
    findings: tuple[Finding, ...]
    notes: tuple[str, ...] = ()
    smallest: tuple[SmallestRule, ...] = ()

    def of(self, question: str) -> tuple[Finding, ...]:
        """Return the findings to a question."""
        return tuple(f for f in self.findings if f.question == question)

    @property
    def not_shown(self) -> tuple[SmallestRule, ...]:
        """The questions to which so few demonstrations could not have shown every strong rule."""
        return tuple(rule for rule in self.smallest if rule.too_few)

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
        reading: How the data were read.
    """

    source: str
    facts_sha256: str
    groups: tuple[GroupAudit, ...]
    reading: DataReading | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form; how the data were read comes first."""
        form = asdict(self)
        del form["reading"]
        read = {} if self.reading is None else {"read": self.reading.paragraph, "reading": asdict(self.reading)}
        return {**read, **form, "alpha": ALPHA, "strong": STRONG, "power": POWER}


def facts_hash(episodes: Sequence[EpisodeFacts]) -> str:
    """Return the SHA-256 over all facts, whatever their order."""
    lines = sorted(repr(facts) for facts in episodes)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def audit_dataset(source: str, episodes: Sequence[EpisodeFacts], reading: DataReading | None = None) -> ShortcutAudit:
    """Return what goes together in a dataset; a function of the facts alone.

    Args:
        source: What is audited.
        episodes: What its demonstrations show.
        reading: How they were read, which the audit repeats.

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
    judged = list(_judged(audited))
    few = {name: len(found) for name, found in groups.items() if len(found) < FEWEST}
    if few and reading is not None:
        told = ", ".join(f"{name} ({count})" for name, count in sorted(few.items()))
        reading = replace(reading, left_out=(*reading.left_out, f"groups of fewer than {FEWEST}: {told}"))
    return ShortcutAudit(source, facts_hash(episodes), tuple(judged), reading)


@dataclass(frozen=True, slots=True)
class _Raw:
    """A finding before the correction.

    Attributes:
        finding: What was found.
        rules: What it rests on.
        certain: Whether one of the rules holds always, or nearly.
        parts: Of a question about words, the words of the one or of the two that it is about.
    """

    finding: Finding
    rules: Rules
    certain: bool = False
    parts: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class _Group:
    """A group of demonstrations, what was found in it and what was asked.

    Attributes:
        pairs: What was asked about pairs of words.
        asked: Questions that were tested.
    """

    name: str
    episodes: Sequence[EpisodeFacts]
    found: list[_Raw]
    notes: list[str]
    pairs: list[_AskedPairs]
    asked: list[_Asked]


@dataclass(frozen=True, slots=True)
class _Asked:
    """A question that was tested, for the smallest rule that would have been found."""

    question: str
    title: str
    planted: Planted
    counts: RuleCounts


@dataclass(frozen=True, slots=True)
class _AskedPairs:
    """A question about pairs of words: of how many demonstrations, words and outcomes."""

    question: str
    title: str
    n: int
    words: int
    outcomes: int


def _audit_group(name: str, episodes: Sequence[EpisodeFacts]) -> _Group:
    handled = handled_kinds(episodes)
    group = _Group(name, episodes, [], [], [], [])
    group.found.extend(raw for q in QUESTIONS if (raw := _answer(group, q, handled)) is not None)
    for question in WORD_OUTCOMES:
        group.found.extend(_answers_about_words(group, question))
    group.found.extend(_constants(episodes))
    return group


def _draw(group: str, question: str) -> np.random.Generator:
    digest = hashlib.sha256(f"shortcuts|{group}|{question}".encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))


def _answer(group: _Group, q: Question, handled: frozenset[str]) -> _Raw | None:
    """Return what a question about named things found, or None where there is nothing to ask."""
    seen = [pair for facts in group.episodes for pair in q.pairs(facts, handled)]
    if len({x for _, x, _ in seen}) < 2 or len({y for _, _, y in seen}) < 2:
        return None
    test = permutation_test(
        [x for _, x, _ in seen],
        [y for _, _, y in seen],
        _draw(group.name, q.name),
        blocks=[block for block, _, _ in seen],
        within=q.within,
    )
    group.asked.append(_Asked(q.name, q.title, planted_question(test), RuleCounts(STRONG, _certain_rule)))
    rules: dict[str, Counter[str]] = {}
    for _, x, y in seen:
        rules.setdefault(x, Counter())[y] += 1
    lines = [q.rule.format(x=x, y=_shares(ys)) for x, ys in sorted(rules.items())]
    if q.name == "order":
        lines = [line for line in lines if not line.endswith("later")]
    return _Raw(_finding(q.name, q.title, "", test.found, lines), rules)


@dataclass(frozen=True, slots=True)
class _Said:
    """Words of the instructions: those that are always said together are one.

    Attributes:
        words: The words of each, apart.
        shown: How each is shown.
        presence: (episodes, words) in which episodes each is said.
    """

    words: tuple[tuple[str, ...], ...]
    shown: tuple[str, ...]
    presence: npt.NDArray[np.bool_]


def _said_in(known: Sequence[EpisodeFacts], notes: list[str]) -> _Said:
    """Return the words that some demonstrations say and some do not; a note tells if some are left out."""
    texts = {text: i for i, text in enumerate(sorted({facts.instruction for facts in known}))}
    of_text = np.array([texts[facts.instruction] for facts in known], dtype=np.int64)
    sizes = np.bincount(of_text, minlength=len(texts))
    said: dict[str, int] = {}
    for text, i in texts.items():
        for word in instruction_words(text):
            said[word] = said.get(word, 0) | 1 << i
    said = without_joined(said)
    alike: dict[int, list[str]] = {}
    for word in sorted(said):
        alike.setdefault(said[word], []).append(word)
    rows = {where: np.flatnonzero([where >> i & 1 for i in range(where.bit_length())]) for where in alike}
    counts = {where: int(sizes[rows[where]].sum()) for where in alike}
    told = [where for where in alike if 2 <= counts[where] <= len(known) - 2]
    if len(told) > MOST_WORDS:
        ranked = sorted(told, key=lambda where: -min(counts[where], len(known) - counts[where]))[:MOST_WORDS]
        note = f"of {len(told):,} words, the {MOST_WORDS:,} that tell the most episodes apart were asked about"
        notes.extend([note] if note not in notes else [])
        kept = set(ranked)
        told = [where for where in told if where in kept]
    presence = np.zeros((len(known), len(told)), dtype=np.bool_)
    listed, shown = list(texts), []
    for column, where in enumerate(told):
        has = np.zeros(len(texts), dtype=np.bool_)
        has[rows[where]] = True
        presence[:, column] = has[of_text]
        words = alike[where]
        plain = all(map(is_spaced, words))
        shown.append(" ".join(words[:6]) if plain else shown_as(words, listed[int(rows[where][0])]))
    return _Said(tuple(tuple(alike[where]) for where in told), tuple(shown), presence)


def _answers_about_words(group: _Group, question: str) -> list[_Raw]:
    """Return what each word of the instructions says about one outcome; words that always go together are one.

    Of a stranger's dataset, also what pairs of words say together.
    """
    title, wording, outcome = WORD_OUTCOMES[question]
    known = [facts for facts in group.episodes if outcome(facts)]
    outcomes = [outcome(facts) for facts in known]
    if len(set(outcomes)) < 2:
        return []
    said = _said_in(known, group.notes)
    if not said.words:
        return []
    raw, every = [], Counter(outcomes)
    tested, null = features_test(said.presence, outcomes, _draw(group.name, question))
    planted = planted_word(said.presence, outcomes, tested, null)
    group.asked.append(_Asked(question, title, planted, RuleCounts(STRONG, _certain_word)))
    for i, found in enumerate(tested):
        seen = Counter(outcomes[row] for row in np.flatnonzero(said.presence[:, i]).tolist())
        line = f"with “{said.shown[i]}”, {wording.format(y=_shares(seen))}"
        finding = _finding(question, title, said.shown[i], found, [line])
        raw.append(_Raw(finding, {" ".join(said.words[i]): seen}, _nearly_always(seen, every), (said.words[i],)))
    if any(facts.privileged for facts in group.episodes):
        return raw
    group.pairs.append(_AskedPairs(question + PAIRS, f"two {title}", len(known), len(said.words), len(every)))
    return raw + _answers_about_pairs(question, said, outcomes)


def _answers_about_pairs(question: str, said: _Said, outcomes: Sequence[str]) -> list[_Raw]:
    """Return the pairs of words that tell an outcome where neither word does."""
    title, wording, _ = WORD_OUTCOMES[question]
    codes, kinds = codes_of(outcomes)
    pairs = telling_pairs(said.presence, codes, fewest=FEWEST)
    every = Counter(outcomes)
    # Of pairs that are said in the same episodes, that with the longer words is shown.
    length = [max(map(len, words)) for words in said.words]
    pairs.sort(key=lambda pair: (pair.p_value, -min(length[pair.first], length[pair.second])))
    raw: list[_Raw] = []
    known = set[bytes]()
    for pair in (p for p in pairs if p.p_value <= ALPHA):
        both = said.presence[:, pair.first] & said.presence[:, pair.second]
        if both.tobytes() in known or len(raw) == MOST_PAIRS:
            continue
        known.add(both.tobytes())
        seen = Counter(outcomes[row] for row in np.flatnonzero(both).tolist())
        shown = [said.shown[i] for i in (pair.first, pair.second)]
        line = f"with “{shown[0]}” and “{shown[1]}” together, {wording.format(y=_shares(seen))}"
        finding = _finding(
            question + PAIRS, f"two {title}", " + ".join(shown), _together(both, codes, kinds, pair), [line]
        )
        parts = (said.words[pair.first], said.words[pair.second])
        raw.append(_Raw(finding, {" ".join(itertools.chain(*parts)): seen}, _nearly_always(seen, every), parts))
    return raw


def _together(both: npt.NDArray[np.bool_], codes: npt.NDArray[np.int64], kinds: int, pair: WordPair) -> Association:
    """Return how the presence of both words goes with an outcome, with the p-value of the pair."""
    joint = np.array([np.bincount(codes[both == there], minlength=kinds) for there in (False, True)], dtype=np.float64)
    hx, hy = entropy_bits(joint.sum(axis=1)), entropy_bits(joint.sum(axis=0))
    bits = max(0.0, hx + hy - entropy_bits(joint.ravel()))
    return Association(round(bits, 6), 0.0, round(min(1.0, bits / max(min(hx, hy), 1e-9)), 6), pair.p_value, len(both))


def _nearly_always(seen: Counter[str], every: Counter[str]) -> bool:
    """Tell whether an outcome follows from what was seen: at least :data:`NEARLY_ALWAYS` of what was open about it."""
    (value, count), n = seen.most_common(1)[0], sum(seen.values())
    usual = every[value] / sum(every.values())
    return n >= FEWEST and (count / n - usual) >= NEARLY_ALWAYS * (1.0 - usual)


def _certain_word(joint: npt.NDArray[np.int64]) -> bool:
    """Tell whether a word is a sure sign; ``joint`` holds the outcomes without and with it, (2, outcomes)."""
    seen, every = (Counter({str(y): int(c) for y, c in enumerate(row)}) for row in (joint[1], joint.sum(axis=0)))
    return _nearly_always(seen, every)


def _certain_rule(joint: npt.NDArray[np.int64]) -> bool:
    """Tell whether some value always goes with the same other one; ``joint`` holds how often each two go together."""
    return _certain({str(x): Counter({str(y): int(c) for y, c in enumerate(row) if c}) for x, row in enumerate(joint)})


_STRONG_SHARE = 0.8
"""Share of demonstrations that a rule of strength :data:`STRONG` between two even words and two even places decides,
in steps of :data:`~betterbench.shortcuts.smallest.STEPS`."""


def _smallest_of(group: _Group, tests: int) -> tuple[SmallestRule, ...]:
    """Return the smallest rule of each question that would have been found, corrected for a number of tests."""
    rules = []
    for asked in group.asked:
        units = int(asked.planted.block.max()) + 1
        noun = "demonstrations" if units <= len(group.episodes) else "observations"
        draw = _draw(group.name, f"{asked.question}|smallest rule")
        planted = asked.planted
        least, strong = (
            planted.least_share(threshold, asked.counts, draw) for threshold in (planted.threshold(ALPHA, tests), -1.0)
        )
        rules.append(smallest_rule(asked.question, asked.title, units, noun, (least, strong)))
    for pairs in group.pairs:
        if pairs.words > 1:
            share = _least_share_of_pairs(pairs, tests)
            shares = (share, _STRONG_SHARE)
            rules.append(smallest_rule(pairs.question, pairs.title, pairs.n, "demonstrations", shares))
    return tuple(rules)


def _least_share_of_pairs(asked: _AskedPairs, tests: int) -> float | None:
    """Return the smallest share of demonstrations that two even words together have to decide to be found."""
    if asked.n // 4 < FEWEST:
        return None
    # Of two even words, the rule is tested in the half that has the first one: with and without the second.
    corrected = tests * (asked.words * (asked.words - 1) // 2) * asked.outcomes
    followed = least_share(asked.n // 2, corrected, ALPHA)
    # Chance decides for one of two even outcomes: a share s that a rule decides makes (1 + s) / 2 follow it.
    return None if followed is None else max(_STRONG_SHARE, math.ceil(STEPS * (2.0 * followed - 1.0)) / STEPS)


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
    places = Counter(f.steps[0].origin for f in episodes if not f.privileged and f.steps and f.steps[0].origin)
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


def _judged(groups: Sequence[_Group]) -> list[GroupAudit]:
    """Correct the p-values of all groups together, and give the verdicts."""
    asked = {(group.name, raw.finding.question) for group in groups for raw in group.found if raw.finding.p_value}
    asked |= {(group.name, pairs.question) for group in groups for pairs in group.pairs}
    judged = []
    for group in groups:
        tests = _tests_of(group.name)
        findings = []
        for raw in group.found:
            p = raw.finding.p_value
            adjusted = None if p is None else round(min(1.0, p * len(asked)), 6)
            seen = {x: dict(sorted(ys.items())) for x, ys in sorted(raw.rules.items())}
            finding = replace(raw.finding, p_adjusted=adjusted, seen=seen)
            findings.append(_verdict(finding, raw, tests))
        clearest, smallest = _clearest(findings, group.found), _smallest_of(group, len(asked))
        judged.append(GroupAudit(group.name, len(group.episodes), clearest, tuple(group.notes), smallest))
    return judged


def _clearest(findings: Sequence[Finding], found: Sequence[_Raw]) -> tuple[Finding, ...]:
    """Return the findings; what is found of a run of characters that is part of a clearer one's is none.

    In a script without spaces a part of a word, and a run that has a word in it, tell in part what the word tells.
    """
    verdicts = [finding.verdict for finding in findings]
    ranked = sorted(
        (i for i, raw in enumerate(found) if raw.parts and findings[i].verdict != "none"),
        key=lambda i: (len(found[i].parts), -findings[i].strength),
    )
    kept: list[int] = []
    for i in ranked:
        about = findings[i].question.removesuffix(PAIRS)
        clearer = (
            j
            for j in kept
            if findings[j].question.removesuffix(PAIRS) == about and findings[j].strength > findings[i].strength
        )
        if any(_is_part(found[i].parts, found[j].parts) for j in clearer):
            verdicts[i] = "none"
        else:
            kept.append(i)
    return tuple(replace(finding, verdict=verdict) for finding, verdict in zip(findings, verdicts, strict=True))


def _is_part(these: Sequence[Sequence[str]], those: Sequence[Sequence[str]]) -> bool:
    """Tell whether each of the words of those overlaps with another one of these, and one at least by characters."""
    if len(those) > len(these):
        return False
    return any(
        all(overlapping(a, b) or set(a) & set(b) for a, b in zip(order, those, strict=False))
        and any(overlapping(a, b) for a, b in zip(order, those, strict=False))
        for order in itertools.permutations(these)
    )


def _tests_of(group: str) -> dict[str, EpisodeFacts] | None:
    """Return what a right policy does in each variation of a task; None if it is no task of ours."""
    if group not in task_names():
        return None
    names = [variation.name for variation in get_task(group).variations]
    return {name: facts_of_condition(resolve_condition(group, name).condition) for name in names}


def _verdict(finding: Finding, raw: _Raw, tests: Mapping[str, EpisodeFacts] | None) -> Finding:
    rules = raw.rules
    sure = finding.p_adjusted is None or finding.p_adjusted <= ALPHA
    if not sure or (finding.strength < STRONG and not raw.certain and not _certain(rules)):
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
