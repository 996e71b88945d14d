"""Rows of the speed table that compare betterbench with robosuite and with LIBERO's own loop.

Each figure is measured in two blocks, with one process of the peer each, started one after the other. If their images
are not new at every step, or their times disagree, a third process is measured. If there are still no two blocks that
can be trusted, the row gives the reason instead of a ratio.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from betterbench.episodes import Observer
from betterbench.interface import ObservationSpec, observation_spec
from betterbench.interface.actions import action_space
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import QUALITIES
from betterbench.tasks import Condition, Task, get_task
from figures import Figure, spread
from pacing import PICTURE_BLOCK, PICTURE_TASK, PICTURE_TASKS, Rehearsal, play, rehearse
from peer import (
    LIBERO,
    MOST_BLOCKS,
    ROBOSUITE,
    Block,
    Peer,
    PeerPackage,
    PeerUnavailableError,
    agreeing,
    installed,
    why_not_believed,
)

BOUNDS = {"fast": 10.0, "standard": 4.0}
"""Required speed ratio with images, by render quality."""

RESET_BOUND = 100.0
"""Required speed ratio of a reset."""

FEW_SCENES = 3
"""Number of compiled scenes in the row about resets; an observer keeps renderers for four."""

Measure = Callable[[Peer], tuple[list[float], list[float]]]
"""Measures a block: our seconds, and those of the peer."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of the blocks of one figure.

    Attributes:
        blocks: All blocks.
        failure: Why the measurement stopped, or an empty text.
    """

    blocks: tuple[Block, ...]
    failure: str

    @property
    def own_s(self) -> list[float]:
        """Our seconds in the trusted blocks."""
        return [s for block in agreeing(self.blocks) or () for s in block.own_s]

    @property
    def peer_s(self) -> list[float]:
        """The peer's seconds in the trusted blocks."""
        return [s for block in agreeing(self.blocks) or () for s in block.peer_s]

    @property
    def refusal(self) -> str:
        """Why there is no ratio, or an empty text."""
        if agreeing(self.blocks) is not None:
            return ""
        return self.failure or why_not_believed(self.blocks)

    @property
    def remark(self) -> str:
        """Text that is added to the note of a ratio."""
        believed = agreeing(self.blocks) or ()
        left_out = [block.described for block in self.blocks if block not in believed]
        return f"; not believed and left out: {'; '.join(left_out)}" if left_out else ""


class PeerRows:
    """The rows that compare with a peer."""

    def __init__(self) -> None:
        self._versions: dict[str, dict[str, str]] = {}

    def versions(self) -> dict[str, dict[str, str]]:
        """Return the versions of the peers that ran, by the peer's name."""
        return self._versions

    def colors(self, *, quick: bool) -> Iterator[Figure]:
        """Compare control steps per second with two color images each."""
        yield from self._steps("peer-rgb", ROBOSUITE, PICTURE_TASKS, everything=False, quick=quick)

    def everything(self, *, quick: bool) -> Iterator[Figure]:
        """Compare control steps per second with colors, depth and instance masks of two cameras."""
        yield from self._steps("peer-all", ROBOSUITE, PICTURE_TASKS, everything=True, quick=quick)

    def libero(self, *, quick: bool) -> Iterator[Figure]:
        """Compare control steps per second with two color images each with LIBERO's own loop."""
        yield from self._steps("libero-rgb", LIBERO, (PICTURE_TASK,), everything=False, quick=quick)

    def _steps(
        self, row: str, package: PeerPackage, tasks: tuple[str, ...], *, everything: bool, quick: bool
    ) -> Iterator[Figure]:
        default = observation_spec("default")
        spec = ObservationSpec("bench", default.cameras, depth=everything, masks=everything)
        limit = (3 if quick else 10) * PICTURE_BLOCK
        text = "two cameras, colors" + (" + depth + masks" if everything else "")
        labels = [(task, quality) for task in tasks for quality in BOUNDS]
        rehearsals = {label: rehearse(label[0], QUALITIES[label[1]]) for label in labels}

        def measure(rehearsal: Rehearsal) -> Measure:
            def block(peer: Peer) -> tuple[list[float], list[float]]:
                observer = Observer(spec)
                try:
                    policy = play(
                        rehearsal, lambda _f, _l: peer.step(1), every=PICTURE_BLOCK, limit=limit, observer=observer
                    )
                finally:
                    observer.close()
                return [s / PICTURE_BLOCK for s in policy.own_s], policy.reference_s

            return block

        outcomes = self._measured(package, [measure(rehearsals[label]) for label in labels], everything=everything)
        for (task, quality), outcome in zip(labels, outcomes, strict=True):
            ratios, note = (), outcome.refusal
            if not note:
                ratios = tuple(b / a for a, b in zip(outcome.own_s, outcome.peer_s, strict=True))
                own, theirs = [1.0 / s for s in outcome.own_s], [1.0 / s for s in outcome.peer_s]
                note = f"{spread(own)} / {spread(theirs)} steps/s{outcome.remark}"
            yield Figure(row, f"{text}, {task}, {quality}", ratios, "x", ">=", BOUNDS[quality], note)

    def _measured(self, package: PeerPackage, measures: list[Measure], *, everything: bool) -> list[Outcome]:
        """Measure figures in blocks until two of each agree.

        Args:
            package: The peer.
            measures: Measures one block of a figure.
            everything: Whether the peer gives depth and masks besides colors.

        Returns:
            The outcomes, in the order of ``measures``.
        """
        blocks: list[list[Block]] = [[] for _ in measures]
        failure = ""
        try:
            for _ in range(MOST_BLOCKS):
                open_ones = [i for i, known in enumerate(blocks) if agreeing(known) is None]
                if not open_ones:
                    break
                with Peer(package.script, python=installed(package)) as peer:
                    peer.make(everything=everything)
                    self._versions[package.name] = peer.versions
                    for i in open_ones:
                        own, theirs = measures[i](peer)
                        blocks[i].append(Block(tuple(own), tuple(theirs), peer.take_doubt()))
        except PeerUnavailableError as error:
            failure = f"peer not available: {error}"
        return [Outcome(tuple(known), failure) for known in blocks]

    def reset(self, *, quick: bool) -> Iterator[Figure]:
        """Measure a reset to a new layout of a compiled scene, and compare it with the peers' resets."""
        resets = [_Resets(task, number=6 if quick else 20) for task in PICTURE_TASKS]
        try:
            for own in resets:
                text, note = f"new layout of a compiled scene, {own.task.id}", "build, reset, check the premise"
                yield Figure("reset", text, tuple(1e3 * s for s in own.times()), "ms", "<=", 15.0, note)
            for package, compared in ((ROBOSUITE, resets), (LIBERO, resets[:1])):
                outcomes = self._measured(package, [own.block for own in compared], everything=False)
                for own, outcome in zip(compared, outcomes, strict=True):
                    yield from _reset_figures(package, own, outcome)
        finally:
            for own in resets:
                own.close()


def _reset_figures(package: PeerPackage, own: _Resets, outcome: Outcome) -> Iterator[Figure]:
    """Compare the resets of one task, without and with images, with those of a peer."""
    task, theirs, refusal = own.task.id, outcome.peer_s, outcome.refusal
    note = refusal or f"{package.name} {spread(theirs)} s, its first two images included, ours none{outcome.remark}"
    ratios = tuple(s / statistics.median(outcome.own_s) for s in theirs)
    yield Figure("reset", f"{package.name}'s reset / ours, {task}", ratios, "x", ">=", RESET_BOUND, note)
    note = refusal or f"ours {spread([1e3 * s for s in own.with_images_s])} ms"
    ratios = tuple(s / statistics.median(own.with_images_s) for s in theirs)
    yield Figure("reset", "the same, ours with two images of 'standard' as well", ratios, "x", note=note)


class _Resets:
    """Our resets of one task with few compiled scenes."""

    def __init__(self, name: str, *, number: int) -> None:
        """Compile the scenes and upload each to a renderer.

        Args:
            name: Task id.
            number: Number of layouts.
        """
        self.task = get_task(name)
        self.with_images_s: list[float] = []
        self._observer = Observer(observation_spec("default"))
        self._layouts = _layouts_of_few_scenes(self.task, number)
        for condition, seed in self._layouts:
            self._time(condition, seed, images=True)

    def close(self) -> None:
        """Free the renderers."""
        self._observer.close()

    def times(self) -> list[float]:
        """Return the seconds of a reset to each layout."""
        return [self._time(condition, seed, images=False) for condition, seed in self._layouts]

    def block(self, peer: Peer) -> tuple[list[float], list[float]]:
        """Reset to each layout, with a few resets of the peer in between."""
        own, theirs = [], []
        for i, (condition, seed) in enumerate(self._layouts):
            own.append(self._time(condition, seed, images=False))
            self.with_images_s.append(self._time(condition, seed, images=True))
            if i % max(1, len(self._layouts) // 3) == 0:
                theirs.append(peer.reset())
        return own, theirs

    def _time(self, condition: Condition, seed: int, *, images: bool) -> float:
        began = time.perf_counter()
        scene = Scene(
            self.task, condition, seed=seed, action_space=action_space("ee_delta"), quality=QUALITIES["standard"]
        )
        state = scene.reset()
        if images:
            self._observer.observe(scene, state)
        return time.perf_counter() - began


def _layouts_of_few_scenes(task: Task, number: int) -> list[tuple[Condition, int]]:
    """Return conditions and seeds with different layouts of few compiled scenes, which are in the cache afterwards.

    Args:
        task: The task.
        number: Number of layouts.
    """
    space, quality = action_space("ee_delta"), QUALITIES["standard"]
    scenes: set[str] = set()
    layouts: list[tuple[Condition, int]] = []
    for seed, condition in itertools.product(range(20 * number), task.training):
        name = Scene(task, condition, seed=seed, action_space=space, quality=quality).compiled.content_hash
        if name in scenes:
            layouts.append((condition, seed))
        elif len(scenes) < FEW_SCENES:
            scenes.add(name)
        if len(layouts) == number:
            break
    return layouts
