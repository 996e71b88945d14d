"""Reading and scoring answers, baselines without images, and asking a server."""

from __future__ import annotations

import json
import threading
from collections import Counter
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.looping import each

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, ModelError, RecordError, RunConflictError
from betterbench.evaluation.figures.views import seen_object
from betterbench.interface.state import in_runs, inner_pixel
from betterbench.vqa.asking import ask_set, prompt_for, read_answers, scores_of
from betterbench.vqa.balance import choose_balanced
from betterbench.vqa.blind import Baseline, baselines
from betterbench.vqa.llm import ChatEndpoint, RefusedError, ScriptedChat, user_message
from betterbench.vqa.nouns import indefinite, mistakable, plural_of
from betterbench.vqa.phrasings import PHRASINGS
from betterbench.vqa.question import Candidate, Difficulty, Form, FrameSource, Question, QuestionType
from betterbench.vqa.scoring import is_right, overlap, parse_answer

JPEG = b"\xff\xd8\xff\xe0"
SOURCE = FrameSource("fast_food", "R1", 0, 3, 0.15, "front")


def question(form, answer, options=(), **changes):
    base = Question(
        "id", QuestionType.STATE, form, "is it held", "Is it so?", tuple(options), answer, "images/a.jpg", 100, 100,
        Difficulty.EASY, (), (), ("is it held",), {}, 0.5, SOURCE,
    )  # fmt: skip
    return replace(base, **changes)


CHOICE = question(Form.CHOICE, "red mug", ("apple", "red mug", "mug"))
YES_NO, NUMBER = question(Form.YES_NO, "Yes"), question(Form.NUMBER, "2")
BOX = question(Form.BOX, "[10, 20, 30, 60]", box=(10, 20, 30, 60))


@each(
    "asked, text, read, stage",
    [
        (CHOICE, "B", "red mug", "strict"),
        (CHOICE, "B. red mug", "red mug", "strict"),
        (CHOICE, "(C)", "mug", "strict"),
        (CHOICE, "red mug.", "red mug", "strict"),
        (CHOICE, "Based on the image, the answer is A", "apple", "tolerant"),
        (CHOICE, "I see a red mug there", "red mug", "tolerant"),
        (CHOICE, "apple or red mug", None, "none"),
        (CHOICE, "D", None, "none"),
        (YES_NO, "yes", "Yes", "strict"),
        (YES_NO, "No, it is not.", "No", "tolerant"),
        (YES_NO, "perhaps", None, "none"),
        (NUMBER, "2", "2", "strict"),
        (NUMBER, "There are two of them", "2", "tolerant"),
        (NUMBER, "2 or 3", None, "none"),
        (BOX, "[10, 20, 30, 60]", "[10, 20, 30, 60]", "strict"),
        (BOX, "The box is (11.5, 20, 30, 60).", "[11.5, 20, 30, 60]", "tolerant"),
        (BOX, "1 2 3", None, "none"),
    ],
)
def test_answers_are_read_in_stages(asked, text, read, stage):
    found = parse_answer(asked, text)
    assert (found.answer, found.stage) == (read, stage)


def test_coordinates_are_read_in_the_unit_that_was_declared():
    assert is_right(BOX, parse_answer(BOX, "[100, 200, 300, 600]", coordinates="thousandths").answer)
    assert is_right(BOX, parse_answer(BOX, "[0.1, 0.2, 0.3, 0.6]", coordinates="fractions").answer)
    assert not is_right(BOX, parse_answer(BOX, "[0.1, 0.2, 0.3, 0.6]").answer)
    lines = prompt_for(BOX, "thousandths").splitlines()
    assert lines[-1].startswith("Answer with [left, top, right, bottom] only, in thousandths of the width")
    assert overlap((0, 0, 2, 2), (1, 0, 3, 2)) == pytest.approx(1 / 3)


@settings(max_examples=30)
@given(st.text(max_size=60))
def test_no_text_breaks_the_reading(text):
    for asked in (CHOICE, YES_NO, NUMBER, BOX):
        is_right(asked, parse_answer(asked, text).answer)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_runs_stand_for_the_pixels_of_a_mask(seed):
    mask = np.random.default_rng(seed).random((6, 7)) < 0.4
    mask[2, 3] = True
    seen = seen_object(mask, 1.0)
    back = np.array([[in_runs(seen.runs, 7, x, y) for x in range(7)] for y in range(6)])
    np.testing.assert_array_equal(back, mask)
    x, y = inner_pixel(seen, 7)
    assert mask[y, x]
    assert not in_runs(seen.runs, 7, 7, 0)
    left, top, right, bottom = seen.box
    assert mask[top:bottom, left:right].sum() == mask.sum() == seen.pixels


def candidates(count, *, leak):
    """Questions about things that are held or not; with a leak, half of the words give the answer away."""
    made = []
    for i in range(count):
        answer, kind = ("Yes", "No")[i % 2], f"thing{i % 7}"
        told = f"{kind} {'indeed' if leak and i % 2 else 'today'}"
        made.append(
            Candidate(
                QuestionType.STATE,
                Form.YES_NO,
                "is it held",
                (kind,),
                answer,
                answer,
                {"a": told},
                (kind,),
                replace(SOURCE, row=i),
            )
        )
    return made


@pytest.mark.parametrize("leak", [False, True])
def test_the_blind_classifier_finds_what_words_give_away_and_nothing_else(leak):
    chosen, draw = choose_balanced(candidates(2100, leak=leak), count=0, seed=1), np.random.default_rng(0)
    asked = [
        question(
            Form.YES_NO,
            c.candidate.answer,
            id=str(i),
            text=PHRASINGS["is it held"][draw.integers(5)].format(**c.candidate.words),
        )
        for i, c in enumerate(chosen)
    ]
    (found,) = baselines(asked, [c.turn for c in chosen])
    assert found.chance == 0.5
    assert (found.blind / found.n > 0.95) if leak else abs(found.excess_points) <= 5.0
    assert found.is_balanced != leak


@pytest.mark.parametrize(
    ("n", "blind", "balanced"), [(127, 66, True), (1270, 660, False), (127, 80, False), (1270, 620, True)]
)
def test_an_excess_over_chance_is_named_if_it_is_more_than_scatter(n, blind, balanced):
    assert Baseline("state", n, blind, 0, 0.465).is_balanced == balanced


@pytest.mark.parametrize("count", [0, 60])
def test_no_kind_of_question_outweighs_the_others_of_its_type(count):
    """A run has many questions about what is held, and few about drawers and fingers."""
    few = [
        replace(c, family=family, group=(family,))
        for family in ("gripper open", "is it open")
        for c in candidates(12, leak=False)
    ]
    held = candidates(300, leak=False)
    held += [replace(c, family="what is held") for c in candidates(300, leak=False)]
    taken = Counter(c.candidate.family for c in choose_balanced([*held, *few], count=count, seed=0))
    holding = taken["is it held"] + taken["what is held"]
    assert taken["gripper open"] == taken["is it open"] == 12
    assert holding <= 26, taken
    assert abs(taken["is it held"] - taken["what is held"]) <= 2


def test_balance_takes_equally_many_of_each_answer_and_drops_what_has_only_one():
    many = candidates(70, leak=False) + [replace(c, bucket="No", answer="No") for c in candidates(35, leak=False)]
    alone = [replace(c, group=("alone",), bucket="Yes", answer="Yes") for c in candidates(20, leak=False)]
    chosen = choose_balanced([*many, *alone], count=40, seed=0)
    answers = [c.candidate.answer for c in chosen]
    assert answers.count("Yes") == answers.count("No") >= 20
    assert all(c.candidate.group != ("alone",) for c in chosen)
    assert [c.candidate for c in choose_balanced([*reversed(many), *alone], count=40, seed=0)] == [
        c.candidate for c in chosen
    ]


def test_names_in_sentences():
    assert [plural_of(k) for k in ("apple", "box", "patty", "mouse")] == ["apples", "boxes", "patties", "computer mice"]
    assert [indefinite(k) for k in ("orange", "fries", "mug")] == ["an orange", "a box of fries", "a mug"]
    assert mistakable("mug", "red mug")
    assert mistakable("box", "lunchbox")
    assert not mistakable("red mug", "red block")


class Server:
    """A chat endpoint that answers by script, and remembers what it was asked."""

    def __init__(self, *script):
        self.script, self.asked = list(script), []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                outer.asked.append((self.path, self.headers.get("Authorization"), body))
                status, text = outer.script.pop(0) if len(outer.script) > 1 else outer.script[0]
                form = {"choices": [{"message": {"content": text}}]} if status == 200 else {"error": {"message": text}}
                reply = {"garbage": b"<html>", "deep": b"[" * 3000}.get(str(text)) or json.dumps(form).encode()
                self.send_response(status)
                self.send_header("Content-Length", str(len(reply)))
                self.end_headers()
                self.wfile.write(reply)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/v1"
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()


@pytest.fixture
def serve():
    servers = []

    def start(*script):
        servers.append(Server(*script))
        return servers[-1]

    yield start
    for server in servers:
        server.server.shutdown()
        server.server.server_close()


def test_an_endpoint_is_asked_in_its_protocol_and_again_if_it_is_busy(serve, monkeypatch):
    server = serve((429, "busy"), (503, "starting"), (200, "Yes"))
    monkeypatch.setenv("MY_KEY", "secret")
    pauses = []
    chat = ChatEndpoint(server.url, "tiny", key_variable="MY_KEY", sleep=pauses.append)
    assert chat.complete([user_message("Is it?", JPEG)]).text == "Yes"
    path, key, body = server.asked[-1]
    assert (path, key, body["model"], body["temperature"]) == ("/v1/chat/completions", "Bearer secret", "tiny", 0)
    image, text = body["messages"][0]["content"]
    assert image["image_url"]["url"].startswith("data:image/jpeg;base64,")
    assert text == {"type": "text", "text": "Is it?"}
    assert pauses == [1.0, 2.0]


@pytest.mark.parametrize(
    ("status", "text", "kind", "says"),
    [
        (400, "image too large", RefusedError, "image too large"),
        (401, "no key", ModelError, "Put the API key into the environment variable OPENAI_API_KEY"),
        (404, "no such model", ModelError, "the name of the model, 'tiny'"),
        (500, "broken", ModelError, "no answer after 2 tries"),
        (200, "garbage", ModelError, "Use the address of a chat endpoint"),
        (200, "deep", ModelError, "Use the address of a chat endpoint"),
        (400, "deep", RefusedError, "HTTP 400"),
    ],
)
def test_what_a_server_refuses_is_one_clear_line(serve, status, text, kind, says):
    chat = ChatEndpoint(serve((status, text)).url, "tiny", tries=2, sleep=lambda _: None)
    with pytest.raises(kind, match=says):
        chat.complete([])


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ([{"type": "text", "text": "It is "}, {"type": "text", "text": "B"}], "It is B"),
        ([{"type": "thinking", "thinking": [{"type": "text", "text": "A?"}]}, {"type": "text", "text": "B"}], "B"),
        (None, ""),
        ([], ""),
    ],
)
def test_an_answer_in_parts_is_its_text(serve, content, text):
    assert ChatEndpoint(serve((200, content)).url, "m").complete([user_message("?")]).text == text


@pytest.mark.parametrize("content", [7, {"text": "B"}, ["B"]])
def test_an_answer_of_another_type_is_no_empty_answer(serve, content):
    url = serve((200, content)).url
    with pytest.raises(ModelError, match=r"has no choices\[0\].message.content"):
        ChatEndpoint(url, "m").complete([user_message("?")])


@pytest.mark.parametrize(
    "form",
    [
        {"choices": []},
        {"choices": [{"message": {"role": "assistant"}, "finish_reason": "content_filter"}]},
    ],
)
def test_a_reply_whose_text_a_filter_removed_is_an_empty_answer(form):
    chat = ChatEndpoint("http://localhost:1/v1", "m")
    assert chat._reply(json.dumps(form).encode(), ()).text == ""


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b'{"error": {"message": "model not loaded"}, "choices": []}', "begins with 'model not loaded'"),
        (b"<html>Sign in</html>", "begins with '<html>Sign in</html>'"),
        (b"", "begins with 'no text'"),
    ],
)
def test_a_reply_of_another_form_is_shown(content, says):
    with pytest.raises(ModelError, match=says):
        ChatEndpoint("http://localhost:1/v1", "m")._reply(content, ())


def test_addresses_that_are_none_and_servers_that_are_gone(serve):
    with pytest.raises(InvalidInputError, match="not an HTTP address"):
        ChatEndpoint("localhost:8000", "tiny")
    with pytest.raises(ModelError, match="no answer after 1 tries"):
        ChatEndpoint("http://127.0.0.1:9/v1", "tiny", tries=1).complete([])


@pytest.mark.physics
@pytest.mark.render
def test_a_set_is_asked_once_and_scored_by_type(made, tmp_path):
    replies = iter([q.reply for q in made.questions])
    count = len(made.questions)
    broken = iter([q.reply for q in made.questions[:7]])

    def breaks(_messages):
        try:
            return next(broken)
        except StopIteration:
            raise ModelError("gone") from None

    file = tmp_path / "answers.jsonl"
    with pytest.raises(ModelError):
        ask_set(made, ScriptedChat(breaks, name="perfect"), file, at_once=1)
    assert len(read_answers(file, made).answers) == 7
    for _ in range(7):
        next(replies)
    answers = ask_set(made, ScriptedChat(lambda _: next(replies), name="perfect"), file, at_once=1)
    assert len(answers.answers) == count
    assert all(s.rate.k == s.rate.n and s.read == s.rate.n for s in scores_of(made, answers))
    with pytest.raises(RunConflictError, match="contains answers of 'perfect'"):
        ask_set(made, ScriptedChat(lambda _: "", name="other"), file)
    mute = ask_set(made, ScriptedChat(lambda _: "?", name="mute"), tmp_path / "mute.jsonl", at_once=3)
    assert [s.rate.k for s in scores_of(made, mute)] == [0] * len(scores_of(made, mute))
    (tmp_path / "bad.jsonl").write_text('{"model": "x", "set_sha256": "0"}\n')
    with pytest.raises(InvalidInputError, match="different set"):
        read_answers(tmp_path / "bad.jsonl", made)
    head, first = file.read_text().splitlines()[:2]
    for more, said in ((first, "is answered twice"), ('{"id": "x", "text": "Yes"}', "x, which is not in the set")):
        (tmp_path / "bad.jsonl").write_text(f"{head}\n{first}\n{more}\n")
        with pytest.raises(RecordError, match=said):
            read_answers(tmp_path / "bad.jsonl", made)
    (tmp_path / "bad.jsonl").write_text("{}\n")
    with pytest.raises(RecordError, match="model: is missing"):
        read_answers(tmp_path / "bad.jsonl", made)
    with pytest.raises(RecordError, match="better vqa SET --ask"):
        read_answers(tmp_path / "missing.jsonl", made)


@pytest.mark.physics
@pytest.mark.render
def test_the_verb_asks_a_server(made, serve, tmp_path, capsys):
    server = serve((200, "Yes"))
    out = tmp_path / "answers.jsonl"
    line = ["vqa", str(made.path), "--ask", server.url, "--model", "tiny", "--answers", str(out), "--json"]
    assert main(line) == 0
    scores = {s["name"]: s for s in json.loads(capsys.readouterr().out)["scores"]}
    assert scores["all"]["rate"]["n"] == len(made.questions) == len(server.asked)
    assert main(line) == 0
    assert len(server.asked) == len(made.questions)
