"""The task of inspect_ai, run by inspect_ai with its mock model; needs inspect_ai installed."""

from __future__ import annotations

import gc

import pytest
from tests.vlm.sighted import own_set, questions

inspect_ai = pytest.importorskip("inspect_ai")

COUNT = 40


class Bytes:
    """Counts tokens as bytes; inspect_ai downloads the tables of a tokenizer otherwise, for each model."""

    def encode(self, text, **_):
        return list(text.encode())

    encode_ordinary = encode


@pytest.mark.filterwarnings("ignore")  # of the libraries of inspect_ai
def test_the_task_scores_as_better_vlm(tmp_path, monkeypatch):
    import tiktoken
    from inspect_ai.model import ModelOutput, get_model

    from betterbench.vlm import inspect_tasks

    monkeypatch.setattr(tiktoken, "get_encoding", lambda _: Bytes())
    items = own_set(tmp_path / "set", COUNT)
    monkeypatch.setattr(inspect_tasks, "find_benchmark", lambda _: Own(items))
    known = {q.text: q for q in questions(COUNT)}

    def reply(messages, *_):
        text = messages[-1].text
        asked = next(q for words, q in known.items() if words in text)
        assert any(part.type == "image" for part in messages[-1].content)
        return ModelOutput.from_content("mockllm/model", "?" if int(asked.id[1:]) % 4 == 0 else asked.reply)

    model = get_model("mockllm/model", custom_outputs=reply)
    (log,) = inspect_ai.eval(
        inspect_tasks.static(data=str(tmp_path)), model=model, log_dir=str(tmp_path / "logs"), display="none"
    )
    assert log.status == "success", log.error
    found = {name: metric.value for score in log.results.scores for name, metric in score.metrics.items()}
    assert found["mean"] == pytest.approx(0.75)
    assert 0 <= found["relation"] <= 1
    assert found["stderr"] >= 0
    assert len(log.samples) == COUNT
    gc.collect()  # streams of inspect_ai that were not closed warn here, and not at the end of all tests
    assert "parsing stage: strict" in {sample.scores["betterbench"].explanation for sample in log.samples}


class Own:
    """Our own sets as a benchmark whose items are given."""

    name, coordinates, groups = "better-vqa", "pixels", ("type", "difficulty", "family")

    def __init__(self, items):
        self.items = items

    def load(self, _folder):
        return self.items
