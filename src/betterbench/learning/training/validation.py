"""Validation of a policy during training: action errors by phase on held-out demonstrations, and a few rollouts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.interface import episode_number, observation_spec
from betterbench.interface.actions import EE_DELTA, ROTATION_PER_UNIT_RAD, TRANSLATION_PER_UNIT_M
from betterbench.learning.training.batches import Batches
from betterbench.learning.training.data import PHASES, TrainingSet
from betterbench.learning.training.questions import AnswerRate, answer_rates
from betterbench.policies.learned.network import ACTION_NUMBERS, LearnerNetwork
from betterbench.policies.learned.policy import LearnedPolicy, Learner, SeeingPolicy
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.interventions import resolve_condition

MOST_FRAMES = 2048
"""Maximum number of frames of held-out demonstrations in a validation. They are evenly spaced."""
_AT_ONCE = 256


@dataclass(frozen=True, slots=True)
class PhaseError:
    """Difference between the next actions of a policy and those of the demonstrator, over the frames of one phase.

    Attributes:
        step: Training step.
        phase: Name of the phase; "all" for all phases together.
        translation_mm: Mean distance between the commanded translations per control step [mm].
        rotation_deg: Mean angle between the commanded rotations per control step [deg].
        gripper_wrong: Fraction of wrong gripper commands.
        frames: Number of compared frames.
    """

    step: int
    phase: str
    translation_mm: float
    rotation_deg: float
    gripper_wrong: float
    frames: int


@dataclass(frozen=True, slots=True)
class Rollout:
    """Outcome of an episode in which a policy acts from the initial state of a held-out demonstration."""

    step: int
    trial: str
    success: bool
    steps: int


def phase_errors(
    network: LearnerNetwork, batches: Batches, data: TrainingSet, recipe: TrainingRecipe, step: int
) -> list[PhaseError]:
    """Return the action errors on held-out demonstrations for each phase, and over all phases ("all").

    Only the first ``execute`` actions of each chunk are compared, since only these are executed. The list is empty if
    no demonstrations are held out.
    """
    frames = data.frames(held_out=True)
    if not len(frames):
        return []
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(np.int64))]
    apart = []
    noise_of = np.random.default_rng(recipe.seed)
    network.eval()
    for start in range(0, len(frames), _AT_ONCE):
        some = frames[start : start + _AT_ONCE]
        shown, wanted, counted = batches.sample(some, training=False)
        drawn = noise_of.standard_normal((len(some), recipe.chunk, ACTION_NUMBERS), dtype=np.float32)
        with torch.inference_mode():
            given = network.act(shown, torch.from_numpy(drawn).to(wanted.device))
        parts = (given.clamp(-1.0, 1.0), wanted, counted)
        apart.append(_apart(*(part[:, : recipe.execute].cpu().numpy() for part in parts)))
    errors = np.concatenate(apart)
    phases = data.phases[frames]
    found = [_mean(step, name, errors[phases == i]) for i, name in enumerate(PHASES) if (phases == i).any()]
    return [*found, _mean(step, "all", errors)]


def right_answers(
    network: LearnerNetwork, batches: Batches, data: TrainingSet, step: int, *, most: int = MOST_FRAMES
) -> list[AnswerRate]:
    """Count the correct answers to questions about held-out demonstrations, by question type.

    A policy cannot give an answer that does not occur in training, so questions with such an answer count as wrong. The
    list is empty without co-training.
    """
    chosen = data.asked(held_out=True)
    if data.questions is None or not len(chosen):
        return []
    chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), most)).round().astype(np.int64))]
    right: list[bool] = []
    network.eval()
    for start in range(0, len(chosen), _AT_ONCE):
        asked = batches.questions(chosen[start : start + _AT_ONCE], training=False)
        with torch.inference_mode():
            right += (network.reply(asked.shown).argmax(dim=1) == asked.answers).tolist()
    return answer_rates(step, [data.questions.types[i] for i in chosen], right)


def _apart(given: np.ndarray, wanted: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Return the errors of each frame as a (B, 3) array.

    The columns are the mean distance [mm], the mean angle [deg], and the fraction of wrong gripper commands.
    """
    weights = counted / counted.sum(axis=1, keepdims=True)
    away = 1000.0 * TRANSLATION_PER_UNIT_M * np.linalg.norm(given[..., :3] - wanted[..., :3], axis=-1)
    turn = np.degrees(ROTATION_PER_UNIT_RAD * np.linalg.norm(given[..., 3:6] - wanted[..., 3:6], axis=-1))
    wrong = (given[..., -1] > 0.0) != (wanted[..., -1] > 0.0)
    return np.stack([(weights * values).sum(axis=1) for values in (away, turn, wrong)], axis=1)


def _mean(step: int, phase: str, errors: np.ndarray) -> PhaseError:
    away, turn, wrong = errors.mean(axis=0).tolist()
    return PhaseError(step, phase, round(away, 4), round(turn, 4), round(wrong, 5), len(errors))


def rollout_trials(data: TrainingSet, count: int) -> list[TrialId]:
    """Return held-out trials for rollouts.

    Successive trials belong to different conditions, so that as many conditions as possible are covered.
    """
    left: dict[tuple[str, str], list[TrialId]] = {}
    for i in np.flatnonzero(data.held_out):
        trial = data.trials[i]
        left.setdefault((trial.task, trial.condition), []).append(trial)
    found: list[TrialId] = []
    while len(found) < count and left:
        for key in list(left):
            found.append(left[key].pop(0))
            if not left[key]:
                del left[key]
    return found[:count]


def roll_out(learner: Learner, trial: TrialId, step: int) -> Rollout:
    """Run a policy in a trial of a training condition. The episode is not saved."""
    found, recipe = resolve_condition(trial.task, trial.condition), learner.trained.recipe
    quality = quality_preset("fast" if recipe.sees == "objects" else recipe.eyes.quality)
    scene = Scene(found.task, found.condition, seed=trial.seed, action_space=EE_DELTA, quality=quality)
    context = TrialContext(policy="learned")
    if recipe.sees == "objects":
        text, episode = found.condition.instruction.text, episode_number(trial.seed)
        acting = LearnedPolicy("learned", learner, text, episode, execute=recipe.execute)
        record = run_episode(scene, acting, context=context).record
    else:
        observer = Observer(observation_spec(recipe.eyes.observation).only(recipe.eyes.cameras))
        try:
            seeing = SeeingPolicy("learned", learner, execute=recipe.execute)
            record = run_episode(scene, seeing, context=context, observer=observer).record
        finally:
            observer.close()
    return Rollout(step, str(trial), record.outcome.success, record.n_steps)
