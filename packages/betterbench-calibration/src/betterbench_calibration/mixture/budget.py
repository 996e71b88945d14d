"""Training budget of a mixture: GPU hours, and the samples, tokens and epochs of each data set.

The paper states the number of GPUs and of pre-training steps, but neither the batch size nor the number of tokens per
step. These numbers are arguments here. Their defaults come from the sources that are cited below.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from betterbench.errors import InvalidInputError, require_between
from betterbench_calibration.mixture.shares import MixturePart

TOKENS_PER_GPU = 8192
"""Number of tokens that one GPU processes in one step.

Source: ``expected_num_tokens`` of Being-H's LIBERO script (BeingBeyond/Being-H@594219ea).
"""

IMAGE_TOKENS = 66
"""Number of tokens of a 224 x 224 image in InternVL3.5: (224 / 14)**2 patches, four per token, and two delimiters."""

PEAK_FLOPS = 312e12
"""Peak rate of dense bfloat16 operations of an A800, which is the same as that of an A100 [FLOP/s]."""


@dataclass(frozen=True, slots=True)
class TokenPrices:
    """Number of tokens per sample for each kind of data. They are estimates, because the paper does not state them.

    Attributes:
        actions: Two images, 3 tokens for the state, 16 for an action chunk, and 69 for text. This is 220 in total.
        image_text: One image, and 154 tokens for text.
        video_text: Eight images, and 172 tokens for text.
    """

    actions: float = 2 * IMAGE_TOKENS + 3 + 16 + 69
    image_text: float = IMAGE_TOKENS + 154
    video_text: float = 8 * IMAGE_TOKENS + 172

    def of(self, kind: str) -> float:
        """Return the number of tokens in a sample of the given kind."""
        return {"actions": self.actions, "image-text": self.image_text, "video-text": self.video_text}[kind]


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """Budget of one data set.

    Attributes:
        name: Name of the data set.
        share: Fraction of all samples.
        samples: Number of samples.
        tokens: Number of tokens.
        token_share: Fraction of all tokens.
        passes: Number of passes over the data set (epochs).
    """

    name: str
    share: float
    samples: float
    tokens: float
    token_share: float
    passes: float


@dataclass(frozen=True, slots=True)
class Budget:
    """Budget of a training run, in total and per data set.

    Attributes:
        gpus: Number of GPUs.
        steps: Number of training steps.
        tokens_per_sample: Mean number of tokens per sample.
        batch: Number of samples per step, on all GPUs together.
        samples: Total number of samples.
        tokens: Total number of tokens.
        gpu_hours: GPU hours, or None if the number of model parameters is not given.
        rows: Budget of each data set.
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
        parts: Data sets with their shares of the samples.
        tokens_per_sample: Mean number of tokens per sample, by name of the data set.
        gpus: Number of GPUs.
        steps: Number of training steps.
        tokens_per_gpu: Number of tokens that one GPU processes in one step.
        parameters: Number of model parameters that are used per token, from which the GPU hours are estimated. The
            forward and backward passes take 6 operations per parameter and token (Kaplan et al., arXiv 2001.08361,
            section 2.1).
        utilization: Fraction of :data:`PEAK_FLOPS` that the training achieves.

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
