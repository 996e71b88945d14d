"""Statistics of a run's requests: cached answers, retries with their reasons, tokens and cost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.vqa.asking import ModelAnswer


@dataclass(frozen=True, slots=True)
class Prices:
    """Prices of a model per million tokens, in any currency.

    Attributes:
        prompt: Price of a million tokens in prompts and images.
        completion: Price of a million tokens in answers.
    """

    prompt: float
    completion: float


@dataclass(frozen=True, slots=True)
class RequestTotals:
    """Totals over all answers of a run.

    Attributes:
        answers: Number of answers, including rejected requests.
        cached: Number of answers from the cache. They cost nothing.
        rejected: Number of rejected requests.
        retried: Number of requests that were sent more than once.
        retries: Number of failed attempts by reason ("HTTP 429", "timeout").
        counted: Number of answers with token counts, among those that were neither cached nor rejected.
        prompt_tokens: Number of tokens in the prompts and images of the counted answers.
        completion_tokens: Number of tokens in the counted answers.
        cut: Number of answers that were cut off at the maximum number of tokens.
    """

    answers: int
    cached: int
    rejected: int
    retried: int
    retries: Mapping[str, int]
    counted: int
    prompt_tokens: int
    completion_tokens: int
    cut: int = 0

    @property
    def sent(self) -> int:
        """Number of answers that were neither cached nor rejected."""
        return self.answers - self.cached - self.rejected

    def cost(self, prices: Prices) -> float | None:
        """Return the cost of the answers with token counts, or None if the server reported no token counts."""
        if self.sent and not self.counted:
            return None
        return (self.prompt_tokens * prices.prompt + self.completion_tokens * prices.completion) / 1e6

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "retries": dict(self.retries)}

    def sentences(self, who: str = "model") -> list[str]:
        """Return sentences about the totals, without the cost.

        Args:
            who: Recipient of the requests, such as "model" or "extractor".
        """
        found = []
        if self.cached:
            rest = "no request was sent" if self.cached == self.answers else "only the others were sent"
            found.append(f"{self.cached:,} of {self.answers:,} answers of the {who} come from the cache; {rest}.")
        if self.retries:
            reasons = ", ".join(f"{reason} {count:,} ×" for reason, count in self.retries.items())
            requests = "1 request" if self.retried == 1 else f"{self.retried:,} requests"
            found.append(f"{requests} to the {who} had to be repeated ({reasons}).")
        if self.cut:
            cure = " A larger --max-tokens gives complete answers." if who == "model" else ""
            many = f"{self.cut:,} of {self.answers:,} answers of the {who}"
            found.append(f"{many} were cut off at the maximum number of tokens.{cure}")
        if self.counted:
            of = "" if self.counted == self.sent else f", counted for {self.counted:,} of {self.sent:,} answers"
            tokens = f"{self.prompt_tokens:,} in prompts, {self.completion_tokens:,} in answers"
            found.append(f"Tokens of the {who}: {tokens}{of}.")
        elif self.sent:
            found.append(f"The {who} reported no token counts.")
        return found

    def cost_sentence(self, prices: Prices) -> str:
        """Describe the cost in one sentence."""
        cost = self.cost(prices)
        if cost is None:
            return "The cost is unknown, because the model reported no token counts."
        shown = f"{cost:,.2f}" if cost >= 1 else f"{cost:.4f}".rstrip("0").rstrip(".")
        least = "" if self.counted == self.sent else "at least "
        return f"Cost: {least}{shown}, at {prices.prompt:g} and {prices.completion:g} per million tokens."


def totals_of(answers: Iterable[ModelAnswer]) -> RequestTotals:
    """Compute the totals of a run's requests from its answers."""
    kept = list(answers)
    sent = [answer for answer in kept if not answer.cached and answer.error is None]
    counted = [a for a in sent if a.prompt_tokens is not None and a.completion_tokens is not None]
    reasons = Counter(reason.partition(":")[0] for answer in kept for reason in answer.retries)
    return RequestTotals(
        answers=len(kept),
        cached=sum(answer.cached for answer in kept),
        rejected=sum(answer.error is not None for answer in kept),
        retried=sum(bool(answer.retries) for answer in kept),
        retries=dict(sorted(reasons.items(), key=lambda found: (-found[1], found[0]))),
        counted=len(counted),
        prompt_tokens=sum(answer.prompt_tokens or 0 for answer in counted),
        completion_tokens=sum(answer.completion_tokens or 0 for answer in counted),
        cut=sum(answer.cut for answer in kept),
    )
