"""Resumable job that fills a suite with certified tasks under quotas.

Scenarios are drawn in rounds. Each draw depends on the seed, the tasks accepted in earlier rounds, and the earlier
draws of the same round, but not on the number of workers or on timing. A drawn scenario is stored before its task is
built. Running the same command again therefore resumes an interrupted job and produces the same files.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from betterbench.errors import InvalidInputError, require_between
from betterbench.generation.asking import ExchangeFile, KeptChat, read_exchanges
from betterbench.generation.asking.exchanges import FILE_NAME as EXCHANGES
from betterbench.generation.asking.prompt import PROMPT_ID
from betterbench.generation.building.job import (
    CATALOGUE,
    BuildItem,
    build_items,
    index_library,
    new_task_id,
    write_suite,
)
from betterbench.generation.building.result import Result, Settings
from betterbench.generation.folder import OFFLINE, GenerateSettings, endpoint_of, write_settings
from betterbench.generation.growth.difficulty import difficulty_of, median_s
from betterbench.generation.growth.likeness import Distinct, key_of_task
from betterbench.generation.growth.proposals import FILE_NAME, Proposal, ProposalFile
from betterbench.generation.growth.quotas import Quota, Supply, require_consistent
from betterbench.generation.growth.result import GrownTask, Growth, QuotaStanding, Stop
from betterbench.generation.growth.sources import Cell, ModelSource, OfflineSource, Source
from betterbench.generation.growth.steering import Steering, Traits
from betterbench.generation.scenario_form import scenario_to_json
from betterbench.jobs import JobProgress, write_durably
from betterbench.quoting import json_text
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.tasks import Axis, get_task, require_suite_name, suite_tasks, task_names
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.vqa.llm import Chat

ROUND = 32
"""Number of scenarios per round.

The results of a round affect the next draws only when the whole round has finished. The number is the same for any
number of workers, so the resulting suite does not depend on the number of workers.
"""
ATTEMPTS_PER_TASK = 3
"""Default maximum number of built scenarios per requested task."""
GROWTH_NAME = "growth.json"
"""Name of the file with the outcome of the growth."""
MOST_TASKS = 10_000
"""Maximum number of tasks that may be requested for a suite."""


@dataclass(frozen=True, slots=True)
class GrowSettings:
    """Settings for growing a suite.

    Attributes:
        until: Number of certified tasks. The growth stops when the suite has this number of tasks.
        author: Template, model, seed and vocabulary of the scenarios. An empty target means all templates.
        build: Number of seeds to certify, and number of demonstrations.
        quotas: Minimum and maximum amounts that the suite must satisfy.
        distinct: Definition of near-duplicate tasks: their objects have the same categories ("categories"), or the same
            categories and colors ("colors").
        unlike: Suites to compare with: "better60", or folders. Near-duplicates of their tasks are left out.
        max_attempts: Maximum number of scenarios that are built. If it is None, three are built per requested task.
        name: Name of the suite, without its digest.
    """

    until: int
    author: GenerateSettings = field(default_factory=lambda: GenerateSettings(""))
    build: Settings = field(default_factory=Settings)
    quotas: tuple[Quota, ...] = ()
    distinct: Distinct = "categories"
    unlike: tuple[str, ...] = ()
    max_attempts: int | None = None
    name: str = "generated"

    @property
    def templates(self) -> tuple[str, ...]:
        """Names of the templates that scenarios are drawn from."""
        return (self.author.target,) if self.author.target else tuple(TEMPLATES)

    @property
    def attempts(self) -> int:
        """Maximum number of scenarios that are built."""
        return ATTEMPTS_PER_TASK * self.until if self.max_attempts is None else self.max_attempts

    def to_json(self) -> dict[str, object]:
        """Return the settings that determine which scenarios are drawn.

        Settings that a later command may increase, such as the number of tasks, are not included.
        """
        author = self.author
        form: dict[str, object] = {
            "schema_version": 1,
            "target": author.target,
            "quotas": [str(quota) for quota in self.quotas],
            "distinct": self.distinct,
            "unlike": sorted(suite if suite == "better60" else Path(suite).resolve().name for suite in self.unlike),
            "seeds": self.build.seeds,
            "demonstrations": self.build.demonstrations,
        }
        if author.asks_model:
            model = "replay" if author.model == OFFLINE else author.model
            return form | {"model": model, "prompt": PROMPT_ID, "vocabulary": author.vocabulary}
        return form | {"model": OFFLINE, "seed": author.seed}


@dataclass(frozen=True, slots=True)
class GrowProgress:
    """Progress of growing a suite.

    Attributes:
        accepted: Number of certified tasks, including the tasks of the current round.
        refused: Number of scenarios that could not be certified.
        left_out: Number of proposed scenarios that were not built.
        last: Result of the last scenario that was built. None while scenarios are drawn.
        proposed: Number of the last proposal.
    """

    accepted: int
    refused: int
    left_out: int
    last: Result | None
    proposed: int


OnGrow = Callable[[GrowProgress], None]


@dataclass(frozen=True, slots=True)
class PreparedGrowth:
    """Checked settings for the growth of a suite.

    Attributes:
        settings: Settings that were checked.
        known: Names of the tasks in other suites, by near-duplicate key (see ``likeness``).
        offline: Source of proposals that uses the grammar, or None if a language model is used.
    """

    settings: GrowSettings
    known: Mapping[str, str]
    offline: OfflineSource | None


def prepare_growth(settings: GrowSettings) -> PreparedGrowth:
    """Check the settings for growing a suite.

    Raises:
        InvalidInputError: If a number is out of range, the quotas contradict each other, or the grammar has too few
            goals for the quotas.
        UnknownNameError: If a template, a context or a suite does not exist.
    """
    author = settings.author
    require_between("--until", settings.until, 1, MOST_TASKS)
    require_suite_name(settings.name, where="--name")
    if author.target and author.sentence:
        cure = "Use the name of a template, or leave it out to use all templates"
        raise InvalidInputError(
            "better generate", "a sentence describes a single scenario, but --until needs many scenarios", cure
        )
    if author.num is not None:
        raise InvalidInputError("--num", "cannot be combined with --until", "Leave out --num")
    endpoint_of(author)
    known = {key_of_task(get_task(t), settings.distinct): t for suite in settings.unlike for t in suite_tasks(suite)}
    offline = None
    if not author.asks_model:
        offline = OfflineSource(settings.templates, seed=author.seed, distinct=settings.distinct, known=known)
    best = Steering(settings.quotas, settings.until, settings.templates).best_share()
    supply: Supply = offline or _UnlimitedSupply(settings.templates)
    require_consistent(settings.quotas, settings.until, supply, best_share=best)
    return PreparedGrowth(settings, known, offline)


class _UnlimitedSupply:
    """Supply of scenarios from a model, which is assumed to be unlimited."""

    def __init__(self, templates: Sequence[str]) -> None:
        self.templates = templates

    def contexts(self) -> None:
        """Return None, because a model may write any context."""

    def goals(self, templates: Collection[str], context: str | None = None) -> None:
        """Return None, because the number of goals is not known."""


def grow_suite(
    prepared: PreparedGrowth,
    out: Path,
    *,
    workers: int = 1,
    chat: Chat | None = None,
    overwrite: bool = False,
    on_progress: OnGrow | None = None,
    on_round: Callable[[Growth], None] | None = None,
) -> Growth:
    """Fill a suite with certified tasks. Repeating the call resumes an interrupted job and produces the same files.

    Args:
        prepared: Checked settings. They cannot be reused for another call.
        out: Folder of the job, open for writing (:class:`~betterbench.jobs.outputs.OutputFolder`).
        workers: Number of worker processes.
        chat: Model to ask instead of the model in the settings.
        overwrite: Whether a folder with other settings may be used.
        on_progress: Called after every proposal and every result.
        on_round: Called after every round with the outcome so far. This outcome does not contain a suite yet.

    Raises:
        InvalidInputError: If the file to replay contains no exchange, or a stored result is damaged.
        ModelError: If the model cannot be reached. All earlier results are kept.
        RecordError: If the journal of proposals was changed.
        RunConflictError: If the folder contains a suite with other settings.
        WorkerError: If worker processes keep dying.
    """
    settings = prepared.settings
    kept = {} if settings.author.replay is None else read_exchanges(settings.author.replay)
    write_settings(out, settings.to_json(), overwrite=overwrite)
    index_library(out)
    with ExitStack() as stack:
        source: Source | None = prepared.offline
        if source is None:
            exchanges = stack.enter_context(ExchangeFile(out / EXCHANGES))
            source = ModelSource(
                settings.templates,
                KeptChat(exchanges, chat or endpoint_of(settings.author), kept),
                stack.enter_context(Catalogue(out / CATALOGUE)),
                contexts=[quota.value for quota in settings.quotas if quota.kind == "context"],
                tries=settings.author.tries,
                open_vocabulary=settings.author.vocabulary == "open",
                distinct=settings.distinct,
                known=prepared.known,
            )
        journal = stack.enter_context(ProposalFile(out / FILE_NAME))
        growing = _Growing(settings, out, source, journal, workers=workers, on_progress=on_progress)
        stop = growing.run(on_round)
        suite = write_suite([t.result for t in growing.tasks if not t.set_aside], out, settings.name)
        grown = growing.outcome(stop, suite)
    write_durably(out / GROWTH_NAME, (json_text(grown.to_json(), indent=1) + "\n").encode())
    return grown


class _Growing:
    """State of the job: all proposals, certified tasks and rejected scenarios so far, in order."""

    def __init__(
        self,
        settings: GrowSettings,
        out: Path,
        source: Source,
        journal: ProposalFile,
        *,
        workers: int,
        on_progress: OnGrow | None,
    ) -> None:
        self._settings, self._out, self._source, self._journal = settings, out, source, journal
        self._workers, self._on_progress = workers, on_progress
        self._steering = Steering(settings.quotas, settings.until, settings.templates)
        self._taken = Counter([*task_names(), *(p.task_id for p in journal.stored if p.is_drawn)])
        self._waiting = deque(journal.stored)
        self._round = 0
        self._proposals: list[Proposal] = []
        self.tasks: list[GrownTask] = []
        self.refused: list[Result] = []
        self._finished: list[Result] = []

    def run(self, on_round: Callable[[Growth], None] | None) -> Stop:
        """Draw and build scenarios in rounds until the growth stops, and return the reason why it stopped."""
        while self._steering.left > 0:
            attempts_left = self._settings.attempts - len(self.tasks) - len(self.refused)
            size = min(ROUND, self._steering.left, attempts_left)
            if size <= 0:
                return "attempts"
            drawn = self._drawn(size)
            if not drawn and not self._waiting:
                return "exhausted"
            results = build_items(
                [BuildItem.of(p.read(), p.task_id) for p in drawn],
                self._out,
                settings=self._settings.build,
                workers=self._workers,
                on_stored=self._finished.append,
                on_progress=self._told,
            )
            self._finished = []
            for proposal, result in zip(drawn, results, strict=True):
                self._take(proposal, result)
            if on_round is not None:
                on_round(self.outcome("reached" if self._steering.left == 0 else "attempts", None))
        return "reached"

    def _drawn(self, size: int) -> list[Proposal]:
        """Return the scenarios of the next round.

        Stored proposals are used first. After that, new proposals are requested.
        """
        drawn: list[Proposal] = []
        self._round = self._waiting[0].round if self._waiting else self._round + 1
        while self._waiting and self._waiting[0].round == self._round and len(drawn) < size:
            proposal = self._waiting.popleft()
            self._note(proposal)
            drawn += [proposal] if proposal.is_drawn else []
        while len(drawn) < size and not self._waiting:
            cell = self._steering.choose(self._source.cells(), [Cell(p.template, p.context) for p in drawn])
            if cell is None:
                break
            proposal = self._proposed(cell, self._round)
            self._journal.append(proposal)
            self._note(proposal)
            drawn += [proposal] if proposal.is_drawn else []
            self._tell(None)
        return drawn

    def _proposed(self, cell: Cell, number: int) -> Proposal:
        position = len(self._proposals) + 1
        found = self._source.propose(cell, position)
        is_drawn = found.outcome == "drawn" and found.scenario is not None
        return Proposal(
            number=position,
            round=number,
            template=cell.template,
            context=cell.context,
            outcome=found.outcome,
            key=found.key,
            task_id=new_task_id(found.scenario.name, self._taken) if is_drawn and found.scenario else "",
            scenario=None if found.scenario is None else scenario_to_json(found.scenario),
            problem=found.problem,
        )

    def _note(self, proposal: Proposal) -> None:
        self._proposals.append(proposal)
        self._source.take(proposal)
        self._steering.note(Cell(proposal.template, proposal.context))

    def _take(self, proposal: Proposal, result: Result) -> None:
        if not result.certified:
            self.refused.append(result)
            return
        axes = Counter(Axis.of(v["name"]).value for v in (result.task or {})["variations"])
        variations = {axis.value: axes[axis.value] for axis in Axis}
        context, level = proposal.read().context, difficulty_of(result.trials).value
        set_aside = self._steering.take(Traits(result.template, context, level, variations))
        seconds = round(median_s(result.trials), 2)
        self.tasks.append(GrownTask(result, context, proposal.key, level, seconds, variations, set_aside))

    def _told(self, progress: JobProgress[Result]) -> None:
        if progress.last is not None:
            self._finished.append(progress.last)
        self._tell(progress.last)

    def _tell(self, last: Result | None) -> None:
        if self._on_progress is None:
            return
        certified = sum(result.certified for result in self._finished)
        refused = len(self.refused) + len(self._finished) - certified
        left_out = sum(not p.is_drawn for p in self._proposals)
        accepted = self._settings.until - self._steering.left + certified
        self._on_progress(GrowProgress(accepted, refused, left_out, last, len(self._proposals)))

    def outcome(self, stop: Stop, suite: Path | None) -> Growth:
        """Return the outcome of the growth so far."""
        source = self._source
        goals, near, known = None, sum(p.outcome == "near_duplicate" for p in self._proposals), 0
        if isinstance(source, OfflineSource):
            keys = {p.key for p in self._proposals}
            goals, known = source.goals(source.templates), len(source.known)
            near = sum(source.scenarios[key] - 1 for key in keys) + sum(source.scenarios[key] for key in source.known)
        return Growth(
            until=self._settings.until,
            stop=stop,
            tasks=tuple(self.tasks),
            refused=tuple(self.refused),
            proposals=tuple(self._proposals),
            quotas=tuple(_standing(*found, self._settings.until) for found in self._steering.standing()),
            goals=goals,
            near_duplicates=near,
            known_goals=known,
            suite=suite,
        )


def _standing(quota: Quota, have: float, is_open: bool, until: int) -> QuotaStanding:
    in_variations = quota.kind == "axis"
    return QuotaStanding(
        quota=str(quota),
        kind=quota.kind,
        value=quota.value,
        have=round(have, 2),
        least=quota.least if in_variations else quota.least_of(until),
        most=None if quota.most is None else quota.most if in_variations else quota.most_of(until),
        unit="% of the variations" if in_variations else "tasks",
        is_open=is_open,
    )
