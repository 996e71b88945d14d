"""Model kind ``learned:CHECKPOINT`` of ``better vlm``: a policy that was also trained to answer questions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.errors import InvalidInputError
from betterbench.vlm.models.eyes import Eyes
from betterbench.vlm.models.kind import ModelKind, ModelOptions

if TYPE_CHECKING:
    from betterbench.vqa.llm import Model, ReplyCache


def _require(options: ModelOptions) -> None:
    if not options.own_set:
        cure = "Use a question set of `better vqa`: `better vlm --data SET --records RUN --model learned:CHECKPOINT`"
        raise InvalidInputError("--model", "a learner can only answer questions about recorded trials", cure)
    needed = (("--data", options.data, "set of `better vqa`"), ("--records", options.records, "run of that set"))
    for option, path, what in needed:
        if path is None:
            raise InvalidInputError(
                option, "is missing; a learner needs recorded states to answer questions", f"Pass the {what}"
            )
    given = {"--eyes": options.eyes is not Eyes.NATIVE, "--coordinates": options.coordinates is not None}
    for option, is_given in given.items():
        if is_given:
            raise InvalidInputError(
                option, "this option does not apply to a learner, since it receives no images", "Leave out this option"
            )


def _make(options: ModelOptions, cache: ReplyCache | None) -> Model:
    del cache  # only requests to an endpoint are stored
    if options.data is None or options.records is None:
        raise ValueError("a learner requires a question set and the run that the questions are about")
    from betterbench.learning.training.answering import LearnerModel
    from betterbench.policies.kinds.learned import LEARNED
    from betterbench.policies.learned.loading import load_learner
    from betterbench.records import RunFolder
    from betterbench.vqa.dataset import read_set

    parsed = LEARNED.parse(options.address)
    learner = load_learner(parsed)
    return LearnerModel(Path(parsed.target).name, learner, read_set(options.data), RunFolder.open(options.records))


LEARNER_MODEL = ModelKind(scheme="learned", make=_make, require=_require, sees=False, one_at_a_time=True)
