"""Requests over HTTP: retries, pauses that a server asks for, tokens, cost, the cache, and images as they are sent."""

from __future__ import annotations

import base64
import io
import json
import threading
import time
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from PIL import Image
from tests.vlm import published

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, ModelError
from betterbench.vlm import RunSettings, evaluate_model, find_benchmark
from betterbench.vlm.pictures import sendable
from betterbench.vlm.prompts import find_prompt
from betterbench.vqa.asking import AnswersHead, Request, ask_all
from betterbench.vqa.llm import ChatEndpoint, ChatModel, RefusedError, Reply, ReplyCache, user_message
from betterbench.vqa.llm.chat import LONGEST_WISH_S
from betterbench.vqa.request_totals import Prices, totals_of

MESSAGES = [user_message("Is it?")]
RESET = "reset"


class Server:
    """A chat endpoint with keep-alive; a script gives (status, text, headers, usage) or RESET for each request."""

    def __init__(self, script):
        self.bodies, self.connections, self.closes = [], 0, False
        outer, lock = self, threading.Lock()

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def setup(self):
                super().setup()
                with lock:
                    outer.connections += 1

            def do_POST(self):
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                with lock:
                    outer.bodies.append(body)
                    step = script(len(outer.bodies), body)
                if step == RESET:
                    self.close_connection = True
                    return
                status, text, headers, usage = (*step, {}, None)[:4] if len(step) < 4 else step
                form = {"choices": [{"message": {"content": text}}]} if status == 200 else {"error": {"message": text}}
                reply = json.dumps(form if usage is None else {**form, "usage": usage}).encode()
                self.send_response(status)
                for name, value in {"Content-Length": str(len(reply)), **headers}.items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(reply)
                self.close_connection = outer.closes

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.handle_error = lambda *_: None  # a client that gave up has closed its connection
        self.url = f"http://127.0.0.1:{self.server.server_port}/v1"
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()


@pytest.fixture
def server():
    started = []

    def start(*script):
        steps = list(script)
        answer = steps[0] if callable(steps[0]) else lambda n, _: steps[min(n, len(steps)) - 1]
        started.append(Server(answer))
        return started[-1]

    yield start
    for one in started:
        one.server.shutdown()
        one.server.server_close()


def endpoint(url, **changes):
    pauses = []
    return ChatEndpoint(url, "tiny", sleep=pauses.append, **changes), pauses


@pytest.mark.parametrize(
    ("header", "pause"),
    [
        ("7", 7.0),
        ("2.5", 2.5),
        ("0", 1.0),  # never less than our own pause
        ("999999", LONGEST_WISH_S),
        (timedelta(hours=9), LONGEST_WISH_S),
        (timedelta(hours=-9), 1.0),
        ("soon", 1.0),
        ("-5", 1.0),
        ("9" * 30, 1.0),
    ],
)
def test_a_pause_that_the_server_asks_for_is_kept_within_bounds(header, pause, server):
    if isinstance(header, timedelta):  # a date, made here: the processes of the tests must collect the same names
        header = format_datetime(datetime.now(UTC) + header, usegmt=True)
    chat, pauses = endpoint(server((429, "slow down", {"Retry-After": header}), (200, "Yes")).url)
    reply = chat.complete(MESSAGES)
    assert reply == Reply("Yes", retries=("HTTP 429: slow down",))
    assert pauses == [pause]


def test_a_date_is_a_pause_from_now(server):
    date = format_datetime(datetime.now(UTC) + timedelta(seconds=60), usegmt=True)
    chat, pauses = endpoint(server((503, "loading", {"Retry-After": date}), (200, "Yes")).url)
    chat.complete(MESSAGES)
    assert 40 < pauses[0] <= 60


def test_every_transient_failure_is_retried_with_its_reason(server):
    chat, pauses = endpoint(server((500, "a"), RESET, (503, "b"), (200, "Yes")).url)
    reply = chat.complete(MESSAGES)
    assert reply.retries[0::2] == ("HTTP 500: a", "HTTP 503: b")
    assert reply.retries[1].startswith("connection reset: ")
    assert pauses == [1.0, 2.0, 4.0]


def test_a_server_that_does_not_answer_in_time_is_a_timeout(server):
    goes_on = threading.Event()

    def slow(number, _body):
        if number == 1:
            goes_on.wait(30)
        return 200, "Yes"

    chat, _ = endpoint(server(slow).url, timeout_s=0.2)
    try:
        chat_thread = threading.Timer(0.4, goes_on.set)  # the server's lock is held meanwhile
        chat_thread.start()
        assert chat.complete(MESSAGES).retries[0].startswith("timeout: ")
    finally:
        goes_on.set()


def test_a_limited_server_is_asked_ten_times_and_a_broken_one_four_times(server):
    busy, broken = server((429, "limit", {"Retry-After": "5000"})), server((502, "broken"))
    chat, pauses = endpoint(busy.url)
    with pytest.raises(ModelError, match=r"after 10 tries \(HTTP 429: limit; the server asks to wait 5000 s\)"):
        chat.complete(MESSAGES)
    assert pauses == [LONGEST_WISH_S] * 9
    with pytest.raises(ModelError, match=r"after 4 tries \(HTTP 502: broken\)"):
        endpoint(broken.url)[0].complete(MESSAGES)
    assert (len(busy.bodies), len(broken.bodies)) == (10, 4)


@pytest.mark.parametrize(
    ("usage", "counts"),
    [
        ({"prompt_tokens": 20, "completion_tokens": 3}, (20, 3)),
        ({"prompt_tokens": 20}, (20, None)),
        ({"prompt_tokens": -1, "completion_tokens": True}, (None, None)),
        ([], (None, None)),
        (None, (None, None)),
    ],
)
def test_tokens_are_those_of_the_server_and_never_guessed(usage, counts, server):
    reply = endpoint(server((200, "Yes", {}, usage)).url)[0].complete(MESSAGES)
    assert (reply.prompt_tokens, reply.completion_tokens) == counts


def asked(url, file, count=6, *, at_once=2, **changes):
    model = ChatModel(endpoint(url, **changes)[0])
    requests = {f"q{i}": Request(f"Question {i}?") for i in range(count)}
    return ask_all(requests, model, AnswersHead("tiny", "0" * 8), file, at_once=at_once)


def test_retries_tokens_and_refusals_are_stored_per_item_and_summed(server, tmp_path):
    def script(number, body):
        question = body["messages"][0]["content"][-1]["text"]
        if question == "Question 1?" and seen.setdefault(question, number) == number:
            return 429, "wait"
        if question == "Question 2?":
            return (503, "busy") if seen.setdefault(question, number) == number else (400, "no image")
        return (200, "Yes", {}, {"prompt_tokens": 10, "completion_tokens": 2} if question != "Question 3?" else None)

    seen = {}
    answers = asked(server(script).url, tmp_path / "a.jsonl", at_once=1).answers
    assert answers["q1"].retries == ("HTTP 429: wait",)
    assert (answers["q2"].retries, answers["q2"].text) == (("HTTP 503: busy",), "")
    assert "no image" in answers["q2"].error
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert lines[2]["retries"] == ["HTTP 429: wait"]
    assert set(lines[4]) == {"id", "text", "error", "seal"}  # the server counted no tokens
    totals = totals_of(answers.values())
    assert (totals.answers, totals.rejected, totals.retried) == (6, 1, 2)
    assert totals.retries == {"HTTP 429": 1, "HTTP 503": 1}
    assert (totals.counted, totals.sent, totals.prompt_tokens, totals.completion_tokens) == (4, 5, 40, 8)
    assert totals.cost(Prices(2.0, 10.0)) == pytest.approx((40 * 2 + 8 * 10) / 1e6)
    assert totals.cost_sentence(Prices(2.0, 10.0)) == "Cost: at least 0.0002, at 2 and 10 per million tokens."
    assert totals.sentences() == [
        "2 requests to the model had to be repeated (HTTP 429 1 ×, HTTP 503 1 ×).",
        "Tokens of the model: 40 in prompts, 8 in answers, counted for 4 of 5 answers.",
    ]
    again = asked("http://127.0.0.1:9/v1", tmp_path / "a.jsonl")
    assert totals_of(again.answers.values()) == totals


def test_without_usage_no_cost_is_given(server, tmp_path):
    totals = totals_of(asked(server((200, "Yes")).url, tmp_path / "a.jsonl").answers.values())
    assert totals.cost(Prices(1.0, 1.0)) is None
    assert totals.sentences("extractor") == ["The extractor reported no token counts."]
    assert totals.cost_sentence(Prices(1.0, 1.0)).startswith("The cost is unknown")


def test_a_rerun_takes_all_replies_from_the_cache(server, tmp_path):
    usage = {"prompt_tokens": 10, "completion_tokens": 2}
    one = server((200, "Yes", {}, usage))
    cache = ReplyCache(tmp_path / "cache")
    first = asked(one.url, tmp_path / "a.jsonl", cache=cache).answers
    again = asked(one.url, tmp_path / "b.jsonl", cache=ReplyCache(tmp_path / "cache")).answers
    assert len(one.bodies) == 6
    assert [a.text for a in again.values()] == [a.text for a in first.values()]
    totals = totals_of(again.values())
    assert (totals.cached, totals.sent, totals.cost(Prices(5.0, 5.0))) == (6, 0, 0.0)
    assert totals.sentences() == ["6 of 6 answers of the model come from the cache; no request was sent."]
    assert totals_of(first.values()).cost(Prices(5.0, 5.0)) == pytest.approx(60e-6 * 5 + 12e-6 * 5)


def test_the_key_is_the_content_of_the_request(server, tmp_path):
    one, other = server((200, "Yes")), server((200, "Yes"))
    cache = ReplyCache(tmp_path)
    png = published.picture(1)
    calls = [
        ({}, [user_message("Is it?", png)], 256),
        ({}, [user_message("Is it so?", png)], 256),
        ({}, [user_message("Is it?", published.picture(2))], 256),
        ({}, [user_message("Is it?", png)], 128),
        ({"further": {"mm_processor_kwargs": {"max_dynamic_patch": 6}}}, [user_message("Is it?", png)], 256),
    ]
    for changes, messages, most in calls * 2:
        endpoint(one.url, cache=cache, **changes)[0].complete(messages, max_tokens=most)
    assert len(one.bodies) == len(calls)
    ChatEndpoint(one.url, "other", cache=cache).complete(calls[0][1])
    endpoint(other.url, cache=cache)[0].complete(calls[0][1])
    assert (len(one.bodies), len(other.bodies)) == (len(calls) + 1, 1)


@pytest.mark.parametrize("damage", ["cut", "changed", "swapped", "empty", "folder", "other"])
def test_a_damaged_entry_is_asked_again(damage, server, tmp_path):
    one = server(lambda n, _: (200, f"answer {n}"))
    cache = ReplyCache(tmp_path)
    chat = endpoint(one.url, cache=cache)[0]
    chat.complete(MESSAGES)
    chat.complete([user_message("Another?")])
    file, another = (next(p for p in tmp_path.rglob("*.json") if f"answer {n}" in p.read_text()) for n in (1, 2))
    text = file.read_text()
    match damage:
        case "cut":
            file.write_text(text[:-9])
        case "changed":
            file.write_text(text.replace("answer 1", "answer 9"))
        case "swapped":
            file.write_bytes(another.read_bytes())
        case "empty":
            file.write_bytes(b"")
        case "folder":
            file.unlink()
            file.mkdir()
        case "other":
            file.write_text("[1]")
    assert chat.complete(MESSAGES) == Reply("answer 3")
    assert chat.complete(MESSAGES).is_cached is (damage != "folder")


def test_a_cache_that_cannot_be_written_is_said_once_and_stops_nothing(server, tmp_path, caplog):
    (tmp_path / "file").write_text("")
    chat = endpoint(server((200, "Yes")).url, cache=ReplyCache(tmp_path / "file" / "cache"))[0]
    assert [chat.complete(MESSAGES).text for _ in range(2)] == ["Yes", "Yes"]
    assert caplog.text.count("replies cannot be stored for later runs") == 1


def test_several_writers_of_one_entry_leave_a_whole_one(tmp_path):
    caches = [ReplyCache(tmp_path) for _ in range(4)]  # as in processes of their own
    key, long = "ab" * 32, "x" * 50_000
    found = []

    def write(cache):
        for _ in range(20):
            cache.put(key, Reply(long, 1, 2))
            found.append(cache.get(key))

    threads = [threading.Thread(target=write, args=(cache,)) for cache in caches]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(found) == {Reply(long, 1, 2, is_cached=True)}
    assert [file.name for file in tmp_path.rglob("*") if file.is_file()] == [f"{key}.json"]


def test_refusals_and_failures_are_not_cached(server, tmp_path):
    one = server((400, "no"), (200, "Yes"))
    chat = endpoint(one.url, cache=ReplyCache(tmp_path))[0]
    with pytest.raises(RefusedError):
        chat.complete(MESSAGES)
    assert chat.complete(MESSAGES).text == "Yes"


def test_connections_are_kept_open_during_a_run_and_replaced_when_the_server_closes_them(server, tmp_path):
    one = server((200, "Yes"))
    asked(one.url, tmp_path / "a.jsonl", 12)
    assert one.connections <= 2
    closing = server((200, "Yes"))
    closing.closes = True
    answers = asked(closing.url, tmp_path / "b.jsonl", 12).answers
    assert len(closing.bodies) == 12
    assert not any(answer.retries for answer in answers.values())


def test_at_most_as_many_pictures_as_requests_are_in_memory(server, tmp_path):
    now, most, lock = [0], [0], threading.Lock()

    def pictures():
        with lock:
            now[0] += 1
            most[0] = max(most[0], now[0])
        return (published.picture(1),)

    def script(_number, _body):
        now[0] -= 1
        return 200, "Yes"

    requests = {f"q{i}": Request(f"Question {i}?", pictures) for i in range(200)}
    model = ChatModel(endpoint(server(script).url)[0])
    ask_all(requests, model, AnswersHead("tiny", "0" * 8), tmp_path / "a.jsonl", at_once=3)
    assert most[0] <= 3


def test_a_slow_request_does_not_stop_the_others(server, tmp_path):
    others = threading.Event()

    def script(number, body):
        return (200, body["messages"][0]["content"][-1]["text"])

    def first():
        assert others.wait(60)
        return ()

    def last():
        others.set()
        return ()

    requests = {
        "q0": Request("0", first),
        **{f"q{i}": Request(str(i)) for i in range(1, 20)},
        "q20": Request("20", last),
    }
    model = ChatModel(endpoint(server(script).url)[0])
    answers = ask_all(requests, model, AnswersHead("tiny", "0" * 8), tmp_path / "a.jsonl", at_once=2).answers
    assert list(answers) == list(requests)


def test_an_error_stops_requests_that_wait(server, tmp_path):
    def script(_number, body):
        return (404, "gone") if "Question 1?" in str(body) else (503, "busy", {"Retry-After": "300"})

    model = ChatModel(ChatEndpoint(server(script).url, "tiny"))
    requests = {f"q{i}": Request(f"Question {i}?") for i in range(2)}
    began = time.monotonic()
    with pytest.raises(ModelError, match="HTTP 404: gone"):
        ask_all(requests, model, AnswersHead("tiny", "0" * 8), tmp_path / "a.jsonl", at_once=2)
    assert time.monotonic() - began < 200


def encoded(image, kind, **options):
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


PIXELS = np.random.default_rng(0).integers(0, 256, (24, 32, 4), dtype=np.uint8)
RGB, RGBA = Image.fromarray(PIXELS[:, :, :3]), Image.fromarray(PIXELS)
DEEP = Image.fromarray(PIXELS[:, :, :2].copy().view(np.uint16)[:, :, 0])


@pytest.mark.parametrize(
    "data",
    [
        encoded(RGB, "BMP"),
        encoded(RGB, "TIFF"),
        encoded(RGBA, "TIFF", compression="tiff_lzw"),
        encoded(RGB, "WEBP", lossless=True),
        encoded(RGBA, "WEBP", lossless=True, exact=True),
        encoded(RGB.convert("P"), "GIF"),
        encoded(RGB.convert("1"), "TIFF"),
        encoded(DEEP, "TIFF"),
        encoded(RGB.convert("CMYK"), "TIFF"),
    ],
    ids=["bmp", "tiff", "tiff alpha", "webp", "webp alpha", "gif", "tiff 1 bit", "tiff 16 bits", "tiff cmyk"],
)
def test_other_formats_are_sent_as_png_with_the_same_pixels(data):
    with Image.open(io.BytesIO(data)) as image:
        mode = image.mode if image.mode != "CMYK" else "RGB"
        before = np.asarray(image.convert("RGB") if image.mode in ("CMYK", "P") else image)
    sent = sendable(data, "picture")
    with Image.open(io.BytesIO(sent)) as image:
        assert (image.format, image.mode) == ("PNG", mode)
        np.testing.assert_array_equal(np.asarray(image.convert("RGB") if mode == "P" else image), before)
    (part, _) = user_message("?", sent)["content"]
    assert part["image_url"]["url"].startswith("data:image/png;base64,")
    assert base64.b64decode(part["image_url"]["url"].partition(",")[2]) == sent


def test_png_and_jpeg_are_sent_unchanged_and_unknown_files_are_errors():
    for kind in ("PNG", "JPEG"):
        data = encoded(RGB, kind)
        assert sendable(data, "picture") is data
        assert user_message("?", data)["content"][0]["image_url"]["url"].startswith(f"data:image/{kind.lower()};")
    with pytest.raises(InvalidInputError, match="has 2 frames, expected one image"):
        sendable(encoded(RGB, "GIF", save_all=True, append_images=[Image.new("RGB", (32, 24))]), "picture")
    with pytest.raises(InvalidInputError, match="which is not PNG, JPEG, GIF or WebP"):
        user_message("?", encoded(RGB, "BMP"))


@pytest.mark.parametrize(("name", "kind"), [("embspatial", "BMP"), ("embspatial", "WEBP"), ("refspatial", "TIFF")])
def test_a_data_set_with_other_formats_is_sent_with_its_true_type(name, kind, serve, tmp_path):
    form = published.embspatial_folder if name == "embspatial" else published.refspatial_raw
    folder = form(tmp_path / "data")
    for file in folder.rglob("*.png"):
        if "mask" not in file.parts:
            file.write_bytes(encoded(Image.open(file), kind))
    one = serve(lambda _: "B")
    line = ["vlm", name, "--data", str(folder), "--model", f"{one.url}#m", "--out", str(tmp_path / "run"), "--no-probe"]
    assert main(line) == 0
    for body in one.asked:
        url = body["messages"][0]["content"][0]["image_url"]["url"]
        assert url.startswith("data:image/png;base64,iVBOR")


def test_the_verb_reports_cache_tokens_cost_and_missing_items(server, tmp_path, capsys, cache_home):
    folder = published.embspatial_json(tmp_path / "data")
    one = server((429, "limit"), (200, "B", {}, {"prompt_tokens": 100, "completion_tokens": 1}))

    def run(out, *more):
        line = ["vlm", "embspatial", "--data", str(folder), "--model", f"{one.url}#m", "--out", str(tmp_path / out)]
        assert main([*line, "--price-in", "2", "--price-out", "8", "--at-once", "1", *more]) == 0
        return " ".join(capsys.readouterr().out.split())

    said = run("a")
    assert len(one.bodies) == 9
    assert "Tokens of the model: 800 in prompts, 8 in answers." in said
    assert "Cost: 0.0017, at 2 and 8 per million tokens." in said
    assert "1 request to the model had to be repeated (HTTP 429 1 ×)." in said
    assert "The data has 8 of the 3,640 items of EmbSpatial-Bench" in said
    said = run("b")
    assert len(one.bodies) == 9
    assert "8 of 8 answers of the model come from the cache; no request was sent." in said
    assert "Cost: 0, at" in said
    found = json.loads((tmp_path / "b" / "result.json").read_text())
    assert found["requests"]["cached"] == 8
    assert found["cost"] == 0.0
    assert found["completeness"]["expected"] == 3640
    run("c", "--no-cache")
    assert len(one.bodies) == 17
    assert any((cache_home / "betterbench" / "replies").rglob("*.json"))


def test_one_price_is_an_error(capsys, tmp_path):
    line = ["vlm", "embspatial", "--model", "http://h/v1#m", "--out", str(tmp_path / "o"), "--price-in", "2"]
    assert main(line) == 2
    assert "--price-out: this price is missing" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["refspatial", "egoplan2"])
def test_missing_items_are_said_by_group(name, tmp_path):
    folder = published.FORMS[name][0](tmp_path / "data")
    benchmark = find_benchmark(name)

    class Model:
        name = "m"

        def answer(self, *_):
            return "A"

    found = evaluate_model(
        benchmark, benchmark.load(folder), Model(), tmp_path / "run", RunSettings(find_prompt(name, None))
    )
    groups = {"refspatial": "location 3 of 100, placement 3 of 100, unseen 3 of 77", "egoplan2": "daily 2 of 439"}[name]
    assert groups in found.completeness.sentence
    assert not found.completeness.is_complete


def test_answers_that_are_cut_off_are_counted_also_from_the_cache(tmp_path):
    form = {"choices": [{"message": {"content": "<think>Let me see"}, "finish_reason": "length"}]}
    chat = ChatEndpoint("http://localhost:1/v1", "m", cache=ReplyCache(tmp_path / "cache"))
    reply = chat._reply(json.dumps(form).encode(), ())
    assert reply.is_cut
    key = chat._cache.key("", b"")
    chat._cache.put(key, reply)

    class Cut:
        name = "m"

        def answer(self, prompt, _pictures):
            return chat._cache.get(key) if prompt == "a" else Reply("B")

    head = AnswersHead("m", "0" * 64)
    for _ in range(2):  # the second time, the answers are read from the file
        found = ask_all({"a": Request("a"), "b": Request("b")}, Cut(), head, tmp_path / "answers.jsonl")
        totals = totals_of(found.answers.values())
        assert totals.cut == 1
        assert "1 of 2 answers of the model were cut off at the maximum number of tokens" in totals.sentences()[1]
