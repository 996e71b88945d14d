"""Shortcut audit: associations in a data set that exceed chance, and the variations in which they do not hold."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.shortcuts.asked import AskedQuestion
from betterbench.demonstrations.shortcuts.association import (
    Association,
    codes_of,
    entropy_bits,
    features_test,
    permutation_test,
)
from betterbench.demonstrations.shortcuts.facts import EpisodeFacts, facts_of_condition
from betterbench.demonstrations.shortcuts.instructions import share_told, whole_test
from betterbench.demonstrations.shortcuts.pairs import WordPair, least_share, telling_pairs
from betterbench.demonstrations.shortcuts.questions import (
    COUNT,
    FIRST_PLACE,
    LANDMARK,
    PAIRS,
    QUESTIONS,
    WHOLE,
    WORD_OUTCOMES,
    WORDS,
    Question,
    WordOutcome,
    base_of,
    handled_kinds,
)
from betterbench.demonstrations.shortcuts.reading import DataReading
from betterbench.demonstrations.shortcuts.smallest import (
    POWER,
    STEPS,
    Planted,
    RuleCounts,
    SmallestRule,
    planted_question,
    planted_word,
    smallest_rule,
)
from betterbench.demonstrations.shortcuts.words import (
    in_order,
    instruction_words,
    is_spaced,
    names_a_place,
    overlapping,
    places_named,
    shown_as,
    without_joined,
)
from betterbench.errors import InvalidInputError, one_line
from betterbench.tasks import get_task, task_names
from betterbench.tasks.interventions import resolve_condition
from betterbench.wording import plural

ALPHA = 0.05
"""Significance level for all questions of an audit together (Bonferroni correction).

In data sets recorded with betterbench, whose states are known, questions about word pairs and complete instructions are
corrected as a separate family."""
STRONG = 0.5
"""Minimum strength of a reported finding.

At this strength, knowing one variable removes half of the other variable's uncertainty.

A weaker finding is reported if a single value, such as a word, always occurs with the same other value. It is also
reported if two words or a complete instruction remove half of the uncertainty that remains when the single words are
known.
"""
RARE = 0.05
"""Minimum fraction of the demonstrations that must have a value.

A less frequent value counts as absent from the data.
"""
FEWEST = 8
"""Minimum number of demonstrations in an audited group."""
NEARLY_ALWAYS = 0.9
"""Minimum fraction of an outcome's uncertainty that a word must remove to count as determining the outcome."""
MOST_LINES = 8
MOST_WORDS = 1000
"""Maximum number of tested words per group.

If there are more, the words that split the episodes most evenly are used.
"""
MOST_PAIRS = 20
_NAMED = "the words name the objects; complete instructions are compared if they name them in the same order"
_MOST_SHOWN = 80
"""Maximum number of characters of an instruction that are shown in a finding."""

Verdict = Literal["shortcut", "regularity", "none"]
"""Verdict on a question of the audit.

A "shortcut" is a rule that does not hold in some variation of the task. For an external data set, which has no
variations, it is a rule that a test could violate. A "regularity" is a rule that holds in every variation of the task,
such as the meaning of a word. "none" means that no association was both significant and strong enough
(:data:`STRONG`).
"""

Rules = Mapping[str, Counter[str]]
"""Number of observations of each second value, for each first value."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Answer of the audit to one question: test statistics, verdict, and the rules that a policy could follow.

    Attributes:
        question: Question name.
        title: The question in words.
        subject: Word or object that the question is about; "" for questions about all objects.
        bits: Mutual information [bit].
        strength: Strength of the association from 0 to 1, see
            :class:`~betterbench.demonstrations.shortcuts.association.Association`. For complete instructions, see
            :class:`~betterbench.demonstrations.shortcuts.instructions.WholeTest`.
        p_value: p-value of the permutation test; None if there was nothing to permute because the value is constant.
        p_adjusted: p-value corrected for multiple tests, i.e. multiplied by the number of questions in the same family.
        n: Number of observations.
        verdict: Verdict, see :data:`Verdict`.
        rules: Rules that a policy could follow, in words.
        seen: Counts that the rules were derived from: for each value of the first variable, the counts of the values of
            the second variable.
        separating: Variations in which correct behavior violates the rule, each with the observation that violates it.
        meaning: Reason why the meaning of the words implies this outcome, which makes the rule legitimate and not a
            shortcut; "" if no reason is known.
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
    meaning: str = ""


@dataclass(frozen=True, slots=True)
class GroupAudit:
    """Findings about the demonstrations of one task, or about one external data set.

    Attributes:
        group: Name of the task or of the data set.
        episodes: Number of demonstrations, or of segments with one instruction.
        findings: One finding per tested question.
        notes: Remarks on questions that could not be tested, with the reasons.
        smallest: For each question, the smallest rule that the audit would have detected with this number of
            demonstrations.
        asked: Tested and untested questions.
    """

    group: str
    episodes: int
    findings: tuple[Finding, ...]
    notes: tuple[str, ...] = ()
    smallest: tuple[SmallestRule, ...] = ()
    asked: tuple[AskedQuestion, ...] = ()

    def of(self, question: str) -> tuple[Finding, ...]:
        """Return the findings that answer the question with the given name."""
        return tuple(f for f in self.findings if f.question == question)

    @property
    def not_shown(self) -> tuple[SmallestRule, ...]:
        """Questions with too few demonstrations, so that even a strong rule could have been missed."""
        return tuple(rule for rule in self.smallest if rule.too_few)

    @property
    def shortcuts(self) -> tuple[Finding, ...]:
        """Findings about rules that a policy could follow although they do not hold in some variation."""
        return tuple(f for f in self.findings if f.verdict == "shortcut")


@dataclass(frozen=True, slots=True)
class ShortcutAudit:
    """Shortcut audit of a data set.

    Attributes:
        source: Name of the audited data set.
        facts_sha256: SHA-256 of the facts on which the audit is based.
        groups: One audit per task.
        reading: Description of the episodes and columns that were read.
    """

    source: str
    facts_sha256: str
    groups: tuple[GroupAudit, ...]
    reading: DataReading | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the audit as a JSON-serializable dict that begins with the description of the data."""
        form = asdict(self)
        del form["reading"]
        read = {} if self.reading is None else {"read": self.reading.paragraph, "reading": asdict(self.reading)}
        return {**read, **form, "alpha": ALPHA, "strong": STRONG, "power": POWER}


def facts_hash(episodes: Sequence[EpisodeFacts]) -> str:
    """Return the SHA-256 of the facts of all episodes. It does not depend on the order of the episodes."""
    lines = sorted(repr(facts) for facts in episodes)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def audit_dataset(source: str, episodes: Sequence[EpisodeFacts], reading: DataReading | None = None) -> ShortcutAudit:
    """Audit the demonstrations of a data set for shortcuts. The result depends only on the facts.

    Args:
        source: Name of the audited data set.
        episodes: Facts of its demonstrations.
        reading: Description of the data set, which is included in the audit.

    Raises:
        InvalidInputError: If no group has enough demonstrations.
    """
    groups: dict[str, list[EpisodeFacts]] = {}
    for facts in sorted(episodes, key=lambda f: (f.group, f.episode)):
        groups.setdefault(facts.group, []).append(facts)
    audited = [_audit_group(name, found) for name, found in groups.items() if len(found) >= FEWEST]
    if not audited:
        most = max(map(len, groups.values()), default=0)
        number = f"{most} demonstration{'' if most == 1 else 's'}"
        problem = f"the largest group has {number}, but at least {FEWEST} are needed"
        raise InvalidInputError(source, problem, "Audit a data set with more demonstrations")
    judged = list(_judged(audited))
    few = {name: len(found) for name, found in groups.items() if len(found) < FEWEST}
    if few and reading is not None:
        told = ", ".join(f"{name} ({count})" for name, count in sorted(few.items()))
        reading = replace(reading, left_out=(*reading.left_out, f"groups of fewer than {FEWEST}: {told}"))
    return ShortcutAudit(source, facts_hash(episodes), tuple(judged), reading)


@dataclass(frozen=True, slots=True)
class _Raw:
    """Finding with a p-value that is not yet corrected for multiple tests.

    Attributes:
        finding: The finding, with the uncorrected p-value.
        rules: Counts that the rules were derived from.
        certain: Whether one of the rules holds always or nearly always.
        parts: Words that the question is about: one entry for a single word, two entries for a pair of words.
        columns: Indices of these words among the tested words.
    """

    finding: Finding
    rules: Rules
    certain: bool = False
    parts: tuple[tuple[str, ...], ...] = ()
    columns: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class _Group:
    """Group of demonstrations, with its questions and findings.

    Attributes:
        pairs: Questions about pairs of words.
        planted: One entry for each question with a permutation test. Artificial rules are planted in the data of the
            question to determine the smallest rule that the test would detect.
        asked: Tested and untested questions.
    """

    name: str
    episodes: Sequence[EpisodeFacts]
    found: list[_Raw] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    pairs: list[_AskedPairs] = field(default_factory=list)
    planted: list[_Asked] = field(default_factory=list)
    asked: list[AskedQuestion] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Asked:
    """Question that was tested, with the data needed to compute the smallest rule that the audit would detect."""

    question: str
    title: str
    planted: Planted
    counts: RuleCounts


@dataclass(frozen=True, slots=True)
class _AskedPairs:
    """Tested question about word pairs, with the counts of demonstrations, word pairs and distinct outcomes."""

    question: str
    title: str
    n: int
    pairs: int
    outcomes: int


def _audit_group(name: str, episodes: Sequence[EpisodeFacts]) -> _Group:
    handled = handled_kinds(episodes)
    group = _Group(name, episodes)
    group.found.extend(raw for q in QUESTIONS if (raw := _answer(group, q, handled)) is not None)
    for outcome in WORD_OUTCOMES.values():
        group.found.extend(_answers_about_words(group, outcome))
    group.found.extend(_constants(episodes))
    return group


def _draw(group: str, question: str) -> np.random.Generator:
    digest = hashlib.sha256(f"shortcuts|{group}|{question}".encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))


def _answer(group: _Group, q: Question, handled: frozenset[str]) -> _Raw | None:
    """Return the finding for a question about objects with known names.

    Return None if one of its two variables is constant.
    """
    seen = [pair for facts in group.episodes for pair in q.pairs(facts, handled)]
    if len({x for _, x, _ in seen}) < 2 or len({y for _, _, y in seen}) < 2:
        named = any(facts.privileged for facts in group.episodes)
        reason = "it is constant" if seen else "no demonstration has this outcome" if named else "objects have no names"
        group.asked.append(AskedQuestion(q.name, q.title, len(seen), untested=reason))
        return None
    group.asked.append(AskedQuestion(q.name, q.title, len(seen)))
    test = permutation_test(
        [x for _, x, _ in seen],
        [y for _, _, y in seen],
        _draw(group.name, q.name),
        blocks=[block for block, _, _ in seen],
        within=q.within,
    )
    group.planted.append(_Asked(q.name, q.title, planted_question(test), RuleCounts(STRONG, _certain_rule)))
    rules: dict[str, Counter[str]] = {}
    for _, x, y in seen:
        rules.setdefault(x, Counter())[y] += 1
    lines = [q.rule.format(x=x, y=_shares(ys)) for x, ys in sorted(rules.items())]
    if q.name == "order":
        lines = [line for line in lines if not line.endswith("later")]
    return _Raw(_finding(q.name, q.title, "", test.found, lines), rules)


@dataclass(frozen=True, slots=True)
class _Said:
    """Words of the instructions. Words that always occur together form one entry.

    Attributes:
        words: Words of each entry.
        shown: Text that represents each entry in findings.
        presence: (episodes, entries) mask of the entries that each episode's instruction contains.
    """

    words: tuple[tuple[str, ...], ...]
    shown: tuple[str, ...]
    presence: npt.NDArray[np.bool_]


def _said_in(known: Sequence[EpisodeFacts], notes: list[str]) -> _Said:
    """Return the words that occur in at least two demonstrations and are absent from at least two demonstrations.

    If there are too many such words, the least informative words are left out, and ``notes`` gets a remark about this.
    """
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
        note = f"of {len(told):,} words, the {MOST_WORDS:,} that distinguish the most episodes were tested"
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


def _answers_about_words(group: _Group, outcome: WordOutcome) -> list[_Raw]:
    """Return the findings on associations of an outcome with words, word pairs and complete instructions."""
    known = [facts for facts in group.episodes if outcome.of(facts)]
    outcomes = [outcome.of(facts) for facts in known]
    if len(set(outcomes)) < 2:
        reason = "it never differs" if known else outcome.missing
        group.asked.append(AskedQuestion(outcome.name, outcome.title(WORDS), len(known), untested=reason))
        return []
    said = _said_in(known, group.notes)
    raw: list[_Raw] = []
    if outcome.is_place or not _picking_words(known):
        raw += _answers_about_single_words(group, outcome, said, outcomes)
        raw += _answers_about_pairs(group, outcome, said, outcomes)
    else:  # words that name the picked objects determine the outcome by their meaning, so they are not shortcuts
        for level in (WORDS, PAIRS):
            question = AskedQuestion(outcome.question(level), outcome.title(level), len(known), untested=_NAMED)
            group.asked.append(question)
    return raw + _answers_about_instructions(group, outcome, (known, said, outcomes), raw)


def _answers_about_single_words(
    group: _Group, outcome: WordOutcome, said: _Said, outcomes: Sequence[str]
) -> list[_Raw]:
    """Return the findings on associations between single words and an outcome.

    Words that always occur together count as one word.
    """
    question, title = outcome.question(WORDS), outcome.title(WORDS)
    if not said.words:
        reason = "no word occurs in some but not all demonstrations"
        group.asked.append(AskedQuestion(question, title, len(outcomes), untested=reason))
        return []
    raw, every = [], Counter(outcomes)
    tested, null = features_test(said.presence, outcomes, _draw(group.name, question))
    planted = planted_word(said.presence, outcomes, tested, null)
    group.planted.append(_Asked(question, title, planted, RuleCounts(STRONG, _certain_word)))
    group.asked.append(AskedQuestion(question, title, len(outcomes), plural(len(said.words), "word")))
    for i, found in enumerate(tested):
        seen = Counter(outcomes[row] for row in np.flatnonzero(said.presence[:, i]).tolist())
        line = f"with “{said.shown[i]}”, {outcome.rule.format(y=_shares(seen))}"
        finding = _finding(question, title, said.shown[i], found, [line])
        rules = {" ".join(said.words[i]): seen}
        raw.append(_Raw(finding, rules, _nearly_always(seen, every), (said.words[i],), (i,)))
    return raw


def _answers_about_pairs(group: _Group, outcome: WordOutcome, said: _Said, outcomes: Sequence[str]) -> list[_Raw]:
    """Return the findings on pairs of words that determine an outcome only when they occur together."""
    question, title = outcome.question(PAIRS), outcome.title(PAIRS)
    codes, kinds = codes_of(outcomes)
    pairs = telling_pairs(said.presence, codes, fewest=FEWEST) if len(said.words) > 1 else []
    if not pairs:
        reason = f"no two words occur together in at least {FEWEST} demonstrations, and also separately"
        group.asked.append(AskedQuestion(question, title, len(outcomes), untested=reason))
    else:
        compared = plural(len(pairs), "pair of words", "pairs of words")
        group.asked.append(AskedQuestion(question, title, len(outcomes), compared))
    if len(said.words) > 1:
        group.pairs.append(_AskedPairs(question, title, len(outcomes), len(pairs), kinds))
    every = Counter(outcomes)
    # If several pairs occur in exactly the same episodes, show the pair with the longer words.
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
        columns = (pair.first, pair.second)
        shown, parts = [said.shown[i] for i in columns], tuple(said.words[i] for i in columns)
        line = f"with “{shown[0]}” and “{shown[1]}” together, {outcome.rule.format(y=_shares(seen))}"
        finding = _finding(question, title, " + ".join(shown), _together(both, codes, kinds, pair), [line])
        certain = pair.gain >= STRONG or _nearly_always(seen, every)
        raw.append(_Raw(finding, {" ".join(itertools.chain(*parts)): seen}, certain, parts, columns))
    return raw


def _answers_about_instructions(
    group: _Group,
    outcome: WordOutcome,
    data: tuple[Sequence[EpisodeFacts], _Said, Sequence[str]],
    found: Sequence[_Raw],
) -> list[_Raw]:
    """Return findings on complete instructions that predict an outcome better than their words and word pairs do.

    Args:
        group: Group of demonstrations.
        outcome: Outcome that the instructions may be associated with.
        data: Demonstrations with a known outcome, the words of their instructions, and the outcomes.
        found: Findings on single words and word pairs.
    """
    question, title = outcome.question(WHOLE), outcome.title(WHOLE)
    known, said, outcomes = data
    texts = [facts.instruction for facts in known]
    telling = sorted({i for raw in found if _counts(raw, raw.finding.p_value) for i in raw.columns})
    meant = _meant(outcome, known)
    strata = [
        f"{meant[text]}|{''.join('01'[int(has)] for has in row)}"
        for text, row in zip(texts, said.presence[:, telling].tolist(), strict=True)
    ]
    whole = whole_test(texts, outcomes, strata, _draw(group.name, question))
    if whole is None:
        reason = "every instruction occurs once" if len(set(texts)) > 1 else "there is one instruction"
        group.asked.append(AskedQuestion(question, title, len(known), untested=reason))
        return []
    compared = plural(whole.instructions, "instruction")
    if len(known) > len(whole.rows):
        compared += f", {plural(len(known) - len(whole.rows), 'demonstration')} with a unique instruction left out"
    group.asked.append(AskedQuestion(question, title, len(whole.rows), compared))
    counts = RuleCounts(math.inf, lambda joint: share_told(joint) >= STRONG)
    group.planted.append(_Asked(question, title, planted_question(whole.test), counts))
    rules: dict[str, Counter[str]] = {}
    for row in whole.rows:
        rules.setdefault(texts[row], Counter())[outcomes[row]] += 1
    lines = [
        f"with “{one_line(text, most=_MOST_SHOWN)}”, {outcome.rule.format(y=_shares(seen))}"
        for text, seen in sorted(rules.items())
    ]
    strength = round(min(1.0, max(0.0, whole.share_told)), 6)
    finding = _finding(question, title, "", replace(whole.beyond, strength=strength), lines)
    return [_Raw(finding, rules)]


def _meant(outcome: WordOutcome, known: Sequence[EpisodeFacts]) -> dict[str, str]:
    """Return the words of each instruction that determine the outcome by their meaning, joined into one string.

    If the outcome is a place, these are the words that name places. If the outcome is the order in which objects are
    moved, these are the words that name objects, in the order in which they appear in the instruction.
    """
    texts = {facts.instruction for facts in known}
    if outcome.is_place or not any(step.word for facts in known for step in facts.steps):
        unknown = not any(facts.privileged for facts in known)
        return {text: places_named(text) if unknown else "" for text in texts}
    words = _picking_words(known)
    return {text: in_order(text, words) for text in texts}


def _picking_words(episodes: Sequence[EpisodeFacts]) -> frozenset[str]:
    """Return the words that instructions use to name the objects that are picked."""
    return frozenset(word for facts in episodes for step in facts.steps for word in instruction_words(step.word))


def _together(both: npt.NDArray[np.bool_], codes: npt.NDArray[np.int64], kinds: int, pair: WordPair) -> Association:
    """Return the association between an outcome and the presence of both words of a pair.

    The p-value was computed earlier, together with the p-values of the other word pairs.
    """
    joint = np.array([np.bincount(codes[both == there], minlength=kinds) for there in (False, True)], dtype=np.float64)
    hx, hy = entropy_bits(joint.sum(axis=1)), entropy_bits(joint.sum(axis=0))
    bits = max(0.0, hx + hy - entropy_bits(joint.ravel()))
    return Association(round(bits, 6), 0.0, round(min(1.0, bits / max(min(hx, hy), 1e-9)), 6), pair.p_value, len(both))


def _nearly_always(seen: Counter[str], every: Counter[str]) -> bool:
    """Return whether knowing a word removes at least the fraction :data:`NEARLY_ALWAYS` of the outcome's uncertainty.

    Args:
        seen: Counts of the outcomes with the word.
        every: Counts of the outcomes in all demonstrations.
    """
    (value, count), n = seen.most_common(1)[0], sum(seen.values())
    usual = every[value] / sum(every.values())
    return n >= FEWEST and (count / n - usual) >= NEARLY_ALWAYS * (1.0 - usual)


def _certain_word(joint: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return a mask of the tables in which the word determines the outcome, as defined by :func:`_nearly_always`.

    Args:
        joint: (tables, 2, outcomes) counts of the outcomes without and with the word.
    """
    seen, every = joint[:, 1], joint.sum(axis=1)
    n, value = seen.sum(axis=1), seen.argmax(axis=1)
    rows = np.arange(len(joint))
    usual = every[rows, value] / every.sum(axis=1)
    told = seen[rows, value] / np.maximum(n, 1) - usual
    return np.asarray((n >= FEWEST) & (told >= NEARLY_ALWAYS * (1.0 - usual)))


def _certain_rule(joint: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return a mask of the tables with a value that determines the other variable, as defined by :func:`_certain`.

    Args:
        joint: (tables, nx, ny) joint counts of the two variables' values.
    """
    several = joint.any(axis=1).sum(axis=1) >= 2
    single = ((joint > 0).sum(axis=2) == 1) & (joint.sum(axis=2) >= FEWEST)
    return np.asarray(several & single.any(axis=1))


_STRONG_SHARE = 0.8
"""Fraction of the demonstrations that a rule of strength :data:`STRONG` determines, while the other demonstrations are
random. The value is computed for two equally frequent words and two equally frequent places, and rounded to a multiple
of 1 / :data:`~betterbench.demonstrations.shortcuts.smallest.STEPS`.
"""


def _smallest_of(group: _Group, counts: Mapping[str, int]) -> tuple[SmallestRule, ...]:
    """Return the smallest rule that the audit would detect, for each question of a group.

    The significance level is corrected for the number of tests in the question's family.
    """
    rules = []
    for asked in group.planted:
        units = int(asked.planted.block.max()) + 1
        noun = "demonstrations" if units <= len(group.episodes) else "observations"
        draw = _draw(group.name, f"{asked.question}|smallest rule")
        planted, tests = asked.planted, counts[_family(group, asked.question)]
        least, strong = (
            planted.least_share(threshold, asked.counts, draw) for threshold in (planted.threshold(ALPHA, tests), -1.0)
        )
        rules.append(smallest_rule(asked.question, asked.title, units, noun, (least, strong)))
    for pairs in group.pairs:
        shares = (_least_share_of_pairs(pairs, counts[_family(group, pairs.question)]), _STRONG_SHARE)
        rules.append(smallest_rule(pairs.question, pairs.title, pairs.n, "demonstrations", shares))
    return tuple(rules)


def _least_share_of_pairs(asked: _AskedPairs, tests: int) -> float | None:
    """Return the smallest fraction of the demonstrations at which the audit detects a rule about two words.

    The rule determines the outcome in this fraction of the demonstrations, and the outcome is random in the others.
    Both words are assumed to occur in half of the demonstrations. Return None if there are too few demonstrations for
    any such rule to be detected.
    """
    if asked.n // 4 < FEWEST:
        return None
    # With two equally frequent words, the test compares episodes with and without the second word in the half of the
    # episodes that contain the first word.
    corrected = tests * max(1, asked.pairs) * asked.outcomes
    followed = least_share(asked.n // 2, corrected, ALPHA)
    # If a rule decides a fraction s of the episodes and the others are random, (1 + s) / 2 of them agree with the rule.
    return None if followed is None else max(_STRONG_SHARE, math.ceil(STEPS * (2.0 * followed - 1.0)) / STEPS)


def _constants(episodes: Sequence[EpisodeFacts]) -> list[_Raw]:
    """Return findings about properties that never change in the data.

    The properties are the slot of a landmark, the number of objects at the start, and the place where the gripper first
    closes.
    """
    raw = []
    slots: dict[str, Counter[str]] = {}
    for facts in episodes:
        for kind, slot in facts.landmarks:
            slots.setdefault(kind, Counter())[slot] += 1
    for kind, found in sorted(slots.items()):
        if len(found) == 1:
            line = f"{kind} is always at {next(iter(found))}"
            raw.append(_constant(LANDMARK, "place of the target", kind, line, {kind: found}))
    counts = Counter(str(len(f.standing)) for f in episodes if f.privileged)
    if len(counts) == 1:
        line = f"{next(iter(counts))} loose objects are on the table at the start"
        raw.append(_constant(COUNT, "number of objects at the start", "", line, {"": counts}))
    places = Counter(f.steps[0].origin for f in episodes if not f.privileged and f.steps and f.steps[0].origin)
    if len(places) == 1 and len({f.instruction for f in episodes}) > 1:
        line = f"with every instruction, the gripper first closes at {next(iter(places))}"
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
    """Format values with their frequencies in percent, starting with the most frequent."""
    total = sum(seen.values())
    ranked = sorted(seen.items(), key=lambda item: (-item[1], item[0]))
    if len(ranked) == 1:
        return ranked[0][0]
    listed = [f"{value} ({100.0 * count / total:.0f} %)" for value, count in ranked[:3]]
    return ", ".join(listed) + (f" and {len(ranked) - 3} more" if len(ranked) > 3 else "")


def _judged(groups: Sequence[_Group]) -> list[GroupAudit]:
    """Correct the p-values of all groups together, and give each finding its verdict."""
    counts = Counter(_family(g, q.question) for g in groups for q in g.asked if not q.untested)
    judged = []
    for group in groups:
        tests = _tests_of(group.name)
        findings = []
        for raw in group.found:
            p = raw.finding.p_value
            count = counts[_family(group, raw.finding.question)]
            adjusted = None if p is None else round(min(1.0, p * count), 6)
            seen = {x: dict(sorted(ys.items())) for x, ys in sorted(raw.rules.items())}
            finding = replace(raw.finding, p_adjusted=adjusted, seen=seen)
            findings.append(_verdict(finding, raw, tests, group.episodes))
        clearest, smallest = _clearest(findings, group.found), _smallest_of(group, counts)
        size, notes = len(group.episodes), tuple(group.notes)
        judged.append(GroupAudit(group.name, size, clearest, notes, smallest, tuple(group.asked)))
    return judged


def _family(group: _Group, question: str) -> str:
    """Return the family of a question. The p-values of the questions in a family are corrected together.

    In data sets recorded with betterbench, questions about several words form a separate family.
    """
    own = any(facts.privileged for facts in group.episodes)
    return "several words" if own and question.endswith((PAIRS, WHOLE)) else ""


def _clearest(findings: Sequence[Finding], found: Sequence[_Raw]) -> tuple[Finding, ...]:
    """Set the verdict "none" for findings about runs of characters that overlap the run of a stronger finding.

    In a script without spaces, runs of characters are tested instead of words. Parts of a word and longer runs that
    contain the word have similar associations, so only the strongest finding is kept.
    """
    verdicts = [finding.verdict for finding in findings]
    ranked = sorted(
        (i for i, raw in enumerate(found) if raw.parts and findings[i].verdict != "none"),
        key=lambda i: (len(found[i].parts), -findings[i].strength),
    )
    kept: list[int] = []
    for i in ranked:
        about = base_of(findings[i].question)
        clearer = (
            j for j in kept if base_of(findings[j].question) == about and findings[j].strength > findings[i].strength
        )
        if any(_is_part(found[i].parts, found[j].parts) for j in clearer):
            verdicts[i] = "none"
        else:
            kept.append(i)
    return tuple(replace(finding, verdict=verdict) for finding, verdict in zip(findings, verdicts, strict=True))


def _is_part(these: Sequence[Sequence[str]], those: Sequence[Sequence[str]]) -> bool:
    """Return whether each part in ``those`` matches a different part in ``these``, including at least one overlap.

    Two parts match if they share a word, or if a word of one part contains a word of the other (``overlapping``).
    """
    if len(those) > len(these):
        return False
    return any(
        all(overlapping(a, b) or set(a) & set(b) for a, b in zip(order, those, strict=False))
        and any(overlapping(a, b) for a, b in zip(order, those, strict=False))
        for order in itertools.permutations(these)
    )


def _tests_of(group: str) -> dict[str, EpisodeFacts] | None:
    """Return the facts about correct behavior in each variation of a task, or None if the group is not a known task."""
    if group not in task_names():
        return None
    names = [variation.name for variation in get_task(group).variations]
    return {name: facts_of_condition(resolve_condition(group, name).condition) for name in names}


def _counts(raw: _Raw, p_value: float | None) -> bool:
    """Return whether a finding is reported.

    A reported finding is significant. It is also strong, or certain (see ``certain`` in :class:`_Raw`).
    """
    if p_value is not None and p_value > ALPHA:
        return False
    always = not raw.finding.question.endswith(WHOLE) and _certain(raw.rules)
    return raw.finding.strength >= STRONG or raw.certain or always


def _verdict(
    finding: Finding, raw: _Raw, tests: Mapping[str, EpisodeFacts] | None, episodes: Sequence[EpisodeFacts]
) -> Finding:
    if not _counts(raw, finding.p_adjusted):
        return finding
    meaning = "the words name the place" if _names_its_place(finding, raw) else ""
    if tests is None or meaning:
        meaning = meaning or _meaning(finding, raw, episodes)
        return replace(finding, verdict="regularity" if meaning else "shortcut", meaning=meaning)
    broken = [(name, why) for name, facts in tests.items() if (why := _breaks(finding, raw, facts))]
    return replace(finding, verdict="shortcut" if broken else "regularity", separating=tuple(broken))


def _names_its_place(finding: Finding, raw: _Raw) -> bool:
    """Return whether a word that is associated with a place occurs in the name of the place, such as "upper"."""
    if not finding.question.endswith(PAIRS):
        return False
    place = next(iter(raw.rules.values())).most_common(1)[0][0]
    said = {word for part in raw.parts for word in part}
    return any(names_a_place((word,)) for word in said & instruction_words(place))


def _meaning(finding: Finding, raw: _Raw, episodes: Sequence[EpisodeFacts]) -> str:
    """Return the reason why the words of a finding imply their outcome. Return "" if no reason is known."""
    outcome = WORD_OUTCOMES.get(base_of(finding.question))
    if outcome is None or not raw.parts:
        return ""
    words = _picking_words(episodes)
    if outcome.is_place or not words:
        return "words for places mean places" if all(map(names_a_place, raw.parts)) else ""
    return "the words name the objects" if all(set(part) <= words for part in raw.parts) else ""


def _certain(rules: Rules) -> bool:
    """Return whether one value of the first variable always occurs with the same value of the second variable.

    Return False if the second variable has the same value in all demonstrations.
    """
    if len({y for ys in rules.values() for y in ys}) < 2:
        return False
    return any(len(ys) == 1 and sum(ys.values()) >= FEWEST for ys in rules.values())


def _breaks(finding: Finding, raw: _Raw, test: EpisodeFacts) -> str:
    """Describe how correct behavior in a variation violates a rule.

    Return "" if the rule holds in the variation.

    Args:
        finding: Finding that states the rule.
        raw: Counts that the rule was derived from.
        test: Facts of correct behavior in the variation.
    """
    rules = raw.rules
    if finding.question == COUNT:
        there = str(len(test.standing))
        things = "thing" if there == "1" else "things"
        return "" if there in rules[""] else f"{there} loose {things} at the start"
    if finding.question == LANDMARK:
        moved = [slot for kind, slot in test.landmarks if kind in rules and slot not in rules[kind]]
        return f"{finding.subject} is at {moved[0]}" if moved else ""
    if base_of(finding.question) in WORD_OUTCOMES:
        return _breaks_words(finding.question, raw, test)
    question = next(q for q in QUESTIONS if q.name == finding.question)
    back: dict[str, Counter[str]] = {}
    for x, ys in rules.items():
        for y, count in ys.items():
            back.setdefault(y, Counter())[x] += count
    for _, x, y in question.pairs(test, None):
        if (x in rules and _is_rare(rules[x], y)) or (question.either_way and y in back and _is_rare(back[y], x)):
            return question.rule.format(x=x, y=y)
    return ""


def _breaks_words(question: str, raw: _Raw, test: EpisodeFacts) -> str:
    outcome = WORD_OUTCOMES[base_of(question)]
    there = outcome.of(test)
    if not there:
        return ""
    if question.endswith(WHOLE):
        seen = raw.rules.get(test.instruction)
    else:
        said = all(set(words) & test.words for words in raw.parts)
        seen = next(iter(raw.rules.values())) if said else None
    return outcome.rule.format(y=there) if seen and _is_rare(seen, there) else ""


def _is_rare(seen: Counter[str], value: str) -> bool:
    return seen[value] < RARE * sum(seen.values())
