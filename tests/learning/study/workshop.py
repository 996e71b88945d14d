"""A workshop without simulator and network: sets are a hash, learners a name, and trials end as their arm would."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, replace

from betterbench.demonstrations.shortcuts.examine import audit_dataset
from betterbench.demonstrations.shortcuts.facts import facts_of_condition
from betterbench.demonstrations.shortcuts.prediction import predict
from betterbench.evaluation import make_plan
from betterbench.learning.study.learning import TrainedPolicy
from betterbench.learning.study.outcomes import TrialOutcome
from betterbench.learning.study.work import Workshop
from betterbench.tasks import get_task
from betterbench.tasks.interventions.regimes import conditions_of


@functools.cache
def prediction_bytes(task: str) -> bytes:
    conditions = conditions_of(get_task(task), "training")
    facts = [replace(facts_of_condition(c), episode=f"{c.id}/{i}") for c in conditions for i in range(12)]
    return predict(audit_dataset(task, facts)).file_bytes()


def played(policy: str, task: str, variation: str | None, condition: str, seed: int) -> TrialOutcome:
    """A confounded learner fails what the audit predicts; a balanced one half of the last variation; a covered none."""
    forecasts = {f["variation"]: f for f in json.loads(prediction_bytes(task))["variations"]}
    risky = variation is not None and forecasts[variation]["risk"] > 0.0
    last = variation == get_task(task).variations[-1].name
    fails = ("-training" in policy and risky) or ("-balanced" in policy and last and seed % 2 == 0)
    label = (forecasts[variation]["label"] if risky else "timeout") if fails else "success"
    return TrialOutcome(
        variation, condition, seed, not fails, label, not fails, "near" if fails or not variation else "far"
    )


def made_up_workshop(
    stop_at: int | None = None, stop: Callable[[], None] = lambda: None, threads: int = 1
) -> tuple[Workshop, list[str]]:
    """Return a workshop and the list of what it did; at call ``stop_at`` it calls ``stop`` in the midst of the work."""
    calls: list[str] = []

    def did(what, out):
        calls.append(f"{what} {out.name}")
        out.mkdir(parents=True, exist_ok=True)
        (out / "half").write_text("half done")
        if len(calls) - 1 == stop_at:
            stop()

    def make_set(recipe, out, tell):
        did("set", out)
        tell(1, 2, "collect")
        (out / "prediction.json").write_bytes(prediction_bytes(recipe.tasks[0]))
        return hashlib.sha256(json.dumps(asdict(recipe)).encode()).hexdigest()

    def ask(source, questions, out, tell):
        did("ask", out)
        assert (source / "prediction.json").exists()
        tell(1, 2, "questions")
        return f"{questions} about {source.name}"

    def train(jobs, tell):
        assert sum(job.recipe.threads for job in jobs) <= threads
        for job in jobs:
            did("train", job.out)
            tell(1, job.recipe.steps, "loss 0.5")
        names = ["+".join(data.rpartition("/")[2] for data in job.recipe.data) for job in jobs]
        return tuple(TrainedPolicy(f"learned:{job.out}", name) for job, name in zip(jobs, names, strict=True))

    def evaluate(policy, task, trials, out, tell):
        did("evaluate", out)
        assert policy.address == f"learned:{out.parent.parent / 'learners' / out.name}"
        planned = make_plan("expert", tasks=(task,), trials=trials).trials
        tell(len(planned), len(planned), "trials")
        return tuple(played(policy.digest, task, t.variation, t.base_condition or t.condition, t.seed) for t in planned)

    return Workshop(make_set, lambda _: None, ask, train, evaluate, threads), calls
