"""Training budget of a mixture: GPU hours, and the samples, tokens and passes of each data set.

The paper gives the number of GPUs and pre-training steps, but neither the batch size nor the tokens per step. These are
arguments here, with defaults from the sources below.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from betterbench.errors import InvalidInputError, require_between
from betterbench_calibration.mixture.shares import MixturePart

TOKENS_PER_GPU = 8192
"""Tokens of one GPU in one step: ``expected_num_tokens`` of Being-H's LIBERO script (BeingBeyond/Being-H@594219ea)."""

IMAGE_TOKENS = 66
"""Tokens of a 224 x 224 image in InternVL3.5: (224 / 14)**2 patches, four per token, and two delimiters."""

PEAK_FLOPS = 312e12
"""Dense bfloat16 operations per second of one A800, as of an A100 [1/s]."""


@dataclass(frozen=True, slots=True)
class TokenPrices:
    """Tokens per sample for each kind of group. They are estimated, because the paper does not state them.

    Attributes:
        actions: Tokens of two pictures, 3 for the state, a chunk of 16 actions, and 69 for text, 220 in total.
        image_text: Tokens of one picture and 154 for text.
        video_text: Tokens of eight pictures and 172 for text.
    """

    actions: float = 2 * IMAGE_TOKENS + 3 + 16 + 69
    image_text: float = IMAGE_TOKENS + 154
    video_text: float = 8 * IMAGE_TOKENS + 172

    def of(self, kind: str) -> float:
        """Return the number of tokens in a sample of a kind."""
        return {"actions": self.actions, "image-text": self.image_text, "video-text": self.video_text}[kind]


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """Samples, tokens, share of the tokens and number of passes of one data set in a budget."""

    name: str
    share: float
    samples: float
    tokens: float
    token_share: float
    passes: float


@dataclass(frozen=True, slots=True)
class Budget:
    """Budget of a run: its samples and tokens, in total and per data set.

    Attributes:
        batch: Number of samples in one step, on all GPUs together.
        gpu_hours: GPU hours, or None if the number of model parameters is not given.
    """

    gpus: int
    steps: int
    tokens_per_sample: float
    batch: float
    samples: float
    tokens: float
    gpu_hours: float | None
    rows: tuple[BudgetRow, ...] = field(default_factory=tuple)


def budget_of(
    parts: Sequence[MixturePart],
    tokens_per_sample: Mapping[str, float],
    *,
    gpus: int,
    steps: int,
    tokens_per_gpu: float = TOKENS_PER_GPU,
    parameters: float | None = None,
    utilization: float = 0.4,
) -> Budget:
    """Return a mixture's training budget for a number of GPUs and steps.

    Args:
        parts: The data sets with their shares of the samples.
        tokens_per_sample: Mean tokens per sample, by name of the data set.
        gpus: Number of GPUs, each of which fills a sequence in every step.
        steps: Number of steps.
        tokens_per_gpu: Number of tokens that one GPU processes in one step.
        parameters: Number of model parameters used per token, to estimate the hours. The forward and backward passes
            take 6 operations per parameter and token (Kaplan et al., 2001.08361, section 2.1).
        utilization: Achieved share of :data:`PEAK_FLOPS`.

    Raises:
        InvalidInputError: If a number is out of range, or a data set has no tokens per sample.
    """
    require_between("gpus", gpus, 1, 1 << 20)
    require_between("steps", steps, 1, 1 << 40)
    require_between("tokens per GPU", tokens_per_gpu, 1, 1 << 40)
    require_between("utilization", utilization, 1e-6, 1.0)
    for part in parts:
        if part.name not in tokens_per_sample:
            raise InvalidInputError("tokens per sample", f"no value for {part.name}", "Give a value for each data set")
        require_between(f"tokens per sample of {part.name}", tokens_per_sample[part.name], 1, 1 << 40)
    mean = sum(part.share * tokens_per_sample[part.name] for part in parts)
    tokens = float(gpus * steps * tokens_per_gpu)
    samples = tokens / mean
    rows = tuple(
        BudgetRow(
            part.name,
            part.share,
            part.share * samples,
            part.share * samples * tokens_per_sample[part.name],
            part.share * tokens_per_sample[part.name] / mean,
            part.share * samples / part.items,
        )
        for part in parts
    )
    hours = None if parameters is None else 6.0 * parameters * tokens / (PEAK_FLOPS * utilization) / 3600.0
    return Budget(gpus, steps, mean, samples / steps, samples, tokens, hours, rows)
