"""Scenarios by a model: hostile, broken and slow answers, corrections, kept exchanges, resuming and replaying."""

from __future__ import annotations

import functools
import json
import re
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from tests.generation.examples import GOOD, changed, described, item, text

from betterbench.errors import InvalidInputError, ModelError, RecordError, RunConflictError
from betterbench.generation.asking import ExchangeFile, KeptChat, ask_for_scenarios, ask_for_template, read_exchanges
from betterbench.generation.asking.author import without_fence
from betterbench.generation.asking.prompt import SYSTEM, scenario_messages
from betterbench.generation.folder import GenerateSettings, generate_scenarios
from betterbench.generation.grammar import nouns_of_library, write_scenarios
from betterbench.generation.scenario_form import answer_to_json
from betterbench.tasks.authoring.template_form import template_to_json
from betterbench.tasks.authoring.templates import LOOSE_PACKING, TEMPLATES
from betterbench.vqa.llm import ChatEndpoint, Reply, ScriptedChat

OTHER = item(0, asset_query="green apple", instance_name="green_apple")


class Model:
    """A model that answers by script; its last answer is repeated."""

    name = "scripted"

    def __init__(self, *script):
        self.script, self.asked = list(script), []

    def complete(self, messages, *, max_tokens=256):  # noqa: ARG002 - part of the protocol
        self.asked.append([dict(m) for m in messages])
        answer = self.script.pop(0) if len(self.script) > 1 else self.script[0]
        if isinstance(answer, BaseException):
            raise answer
        return Reply(answer)


def asked(model, folder, count=1, **options):
    with ExchangeFile(folder / "exchanges.jsonl") as file:
        return ask_for_scenarios("loose_packing", KeptChat(file, model), count, **options)


def lines_of(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_the_prompt_has_the_inputs_and_outputs_of_the_paper():
    system, user = scenario_messages(LOOSE_PACKING, number=4, vocabulary={"items": ("red apple",)}, sentence="Pack it.")
    for field in ("meta", "object_groups", "group_id", "description", "allowed_types", "count_range"):
        assert f'"{field}"' in system["content"]
    for field in (*GOOD, *GOOD["instantiation"]["items"][0]):
        assert f'"{field}"' in system["content"]
    template = json.loads(re.search(r"Template:\n(.*?\n})\n", user["content"], re.DOTALL)[1])
    assert template == json.loads(json.dumps(template_to_json(LOOSE_PACKING)))
    assert "Write 1 scenario, beginning with number 4." in user["content"]
    assert "- items: red apple" in user["content"]
    assert "Pack it." in user["content"]
    assert "8 cm" in SYSTEM


def test_a_good_answer_is_accepted_with_and_without_a_code_fence(tmp_path):
    model = Model(text(GOOD), f"```json\n{text(OTHER)}\n```\n")
    found = asked(model, tmp_path, 2)
    assert [s.groups["items"][0].asset_query for s in found.scenarios.values()] == ["red apple", "green apple"]
    assert found.refused == ()
    assert "red apple" in model.asked[1][1]["content"]  # the second prompt lists the first scenario
    kept = lines_of(tmp_path / "exchanges.jsonl")
    assert [k["verdict"] for k in kept] == ["accepted", "accepted"]
    assert kept[0]["messages"] == model.asked[0]
    assert kept[0]["model"] == "scripted"
    assert kept[0]["answer"] == text(GOOD)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", kept[0]["asked_at"])


WRONG = {
    "malformed JSON": (text(GOOD)[:-9], "answer: is not JSON ("),
    "empty": ("  \n", "answer: is empty"),
    "refusal": ("I cannot help with that.", "answer: is not JSON: 'I cannot help with that.'"),
    "prose around": (f"Here you are:\n{text(GOOD)}", "answer: is not JSON: 'Here you are: ["),
    "no list": (json.dumps(GOOD), "answer: is a JSON object and not a list"),
    "two": (json.dumps([GOOD, OTHER]), "answer: is a list of 2 scenarios"),
    "none": ("[]", "answer: is a list of 0 scenarios"),
    "a number": ("[1]", "answer[0]: "),
    "deep": ("[" * 5000, "answer: is not JSON ("),
    "duplicate key": (text(GOOD).replace('"scene_context"', '"instruction"'), "is given twice"),
    "unknown field": (text(changed(["safety"], "x")), "answer[0]: safety: is unknown"),
    "wrong count": (
        text(changed(["instantiation", "container"], [])),
        "answer[0]: instantiation.container: has 0 objects",
    ),
    "absurd size": (text(item(0, estimated_size=[0.8, 0.9])), "answer[0]: instantiation.items[0].estimated_size: "),
    "absurd mass": (text(item(0, estimated_mass=[20, 30])), "answer[0]: instantiation.items[0].estimated_mass: "),
    "markup": (
        text(item(0, description="<img src=x onerror=alert(1)>")),
        "answer[0]: instantiation.items[0].description: contains '<'",
    ),
    "path": (text(changed(["scenario_name"], "../../.ssh/authorized")), "answer[0]: scenario_name: contains '/'"),
    "shell": (text(changed(["scenario_name"], "lunch; rm -rf $HOME")), "answer[0]: scenario_name: contains ';'"),
    "control": (text(changed(["instruction"], "Pack it.\u0000")), "answer[0]: instruction: contains '\\x00'"),
    "surrogate": (text(GOOD).replace("kitchen", "\\ud800"), "answer[0]: "),
    "duplicate name": (text(item(1, instance_name="apple")), "items[1].instance_name: 'apple' is also the name of"),
    "chained": (
        text(changed(["instruction"], "Put the apple into the lunchbox, then the lemon.")),
        "answer[0]: instruction: chains steps with 'then'",
    ),
    "absent": (text(changed(["instruction"], "Put the banana into the lunchbox.")), "instruction: names a banana"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_answer_goes_back_with_the_path_and_the_next_one_counts(tmp_path, case):
    answer, said = WRONG[case]
    model = Model(answer, text(GOOD))
    found = asked(model, tmp_path)
    assert len(found.scenarios) == 1
    first, second = model.asked
    assert second[: len(first)] == first
    assert second[-2]["role"] == "assistant"
    assert said in second[-1]["content"]
    first_line, last_line = lines_of(tmp_path / "exchanges.jsonl")
    assert said in first_line["verdict"]
    assert "\n" not in first_line["verdict"]
    assert last_line["verdict"] == "accepted"


def test_after_the_last_try_the_scenario_is_left_out_with_its_problem_and_the_next_is_asked_for(tmp_path):
    refusal = "I'm sorry, but I cannot do that."
    model = Model(refusal, refusal, refusal, text(GOOD))
    found = asked(model, tmp_path, 2, tries=3)
    assert list(found.scenarios) == [2]
    (refused,) = found.refused
    assert (refused.number, refused.tries) == (1, 3)
    assert refusal in refused.problem
    assert len(model.asked) == 4


def test_the_same_objects_again_are_refused(tmp_path):
    model = Model(text(GOOD), text(changed(["scenario_name"], "Another name")), text(OTHER))
    found = asked(model, tmp_path, 2)
    assert len(found.scenarios) == 2
    assert "has the same objects as the scenario 'Packing a hiking lunch'" in model.asked[-1][-1]["content"]


def test_a_closed_vocabulary_names_the_closest_object(tmp_path):
    words = nouns_of_library("loose_packing")
    assert "red apple" in words["items"]
    wrong = text(item(0, asset_query="purple apple"))
    model = Model(wrong, text(GOOD))
    asked(model, tmp_path, vocabulary=words)
    said = model.asked[-1][-1]["content"]
    assert "instantiation.items[0].asset_query: Unknown object of the library 'purple apple'. Did you mean" in said


def test_the_objects_of_a_sentence_must_be_there(tmp_path):
    without = changed(["instantiation", "items", 1], described("can", "red soda can", [0.2, 0.4], [0.09, 0.13], "food"))
    model = Model(text(without), text(GOOD))
    asked(model, tmp_path, sentence="Pack an apple and a lemon into a lunchbox.")
    assert (
        "instantiation: the request names a lemon, which is not among the objects. Add it."
        in model.asked[-1][-1]["content"]
    )


@functools.cache
def the_desk():
    return next(s for s in write_scenarios("patterned_arrangement", 7) if s.groups["anchor"][0].tags[0] == "laptop")


def desk(instruction):
    """Return an answer with a laptop and three objects."""
    return text({**answer_to_json(the_desk()), "instruction": instruction})


def arranged(model, folder, **options):
    with ExchangeFile(folder / "exchanges.jsonl") as file:
        return ask_for_scenarios("patterned_arrangement", KeptChat(file, model), 1, **options)


@pytest.mark.parametrize(
    ("instruction", "said"),
    [
        ("Arrange the items in front of the laptop.", "asks for 'in front of'.*left, right, and behind a laptop"),
        ("Arrange the items around the laptop without touching it.", "asks for 'without'"),
        ("Arrange the items between the laptop and the edge.", "asks for 'between'"),
        ("Arrange five items around the laptop.", "asks for 'five'"),
    ],
)
def test_an_instruction_of_a_model_with_another_goal_goes_back_with_the_word(tmp_path, instruction, said):
    model = Model(desk(instruction), desk("Arrange the items around the laptop."))
    found = arranged(model, tmp_path)
    assert [s.instruction for s in found.scenarios.values()] == ["Arrange the items around the laptop."]
    assert re.search(said, lines_of(tmp_path / "exchanges.jsonl")[0]["verdict"])


def test_a_place_of_the_request_must_be_in_the_instruction_of_a_model(tmp_path):
    name = the_desk().groups["items"][0].instance_name.replace("_", " ")
    wanted = f"Put the {name} to the left of the laptop."
    model = Model(desk("Arrange the items around the laptop."), desk(wanted))
    found = arranged(model, tmp_path, sentence=wanted)
    assert [s.instruction for s in found.scenarios.values()] == [wanted]
    assert "lacks a place that the request states" in lines_of(tmp_path / "exchanges.jsonl")[0]["verdict"]
    (tmp_path / "no").mkdir()
    impossible = arranged(Model(desk(wanted)), tmp_path / "no", sentence=f"Put the {name} in front of the laptop.")
    assert "the request asks for 'in front of'" in impossible.refused[0].problem


def test_a_model_chooses_the_template_and_a_wrong_one_goes_back(tmp_path):
    model = Model('{"template": "packing"}', '```\n{"template": "loose_packing"}\n```')
    with ExchangeFile(tmp_path / "e.jsonl") as file:
        assert ask_for_template("Pack it.", KeptChat(file, model)) == "loose_packing"
    assert all(name in model.asked[0][1]["content"] for name in TEMPLATES)
    assert "Unknown template 'packing'. Did you mean 'loose_packing'" in model.asked[1][-1]["content"]
    with ExchangeFile(tmp_path / "f.jsonl") as file, pytest.raises(InvalidInputError, match="chose no template"):
        ask_for_template("Sing.", KeptChat(file, Model('{"template": ""}', "[]", "no")), tries=3)


BURGER = {
    "scenario_name": "Making a burger",
    "instruction": "Build a burger on the bottom bun.",
    "scene_context": "kitchen",
    "instantiation": {
        "base": [described("base", "bottom bun", [0.05, 0.07], [0.07, 0.08])],
        "layers": [
            described("patty", "burger patty", [0.05, 0.06], [0.065, 0.07]),
            described("cheese", "cheese slice", [0.05, 0.06], [0.06, 0.07]),
        ],
    },
}


def test_a_sentence_is_answered_by_a_model_and_repeated_without_it(tmp_path):
    script = ['{"template": "logical_assembly"}', text(BURGER)]
    settings = GenerateSettings("build a burger with cheese", model="http://localhost:1/v1#tiny")
    made = generate_scenarios(settings, tmp_path / "out", chat=Model(*script))
    assert made.template == "logical_assembly"
    assert list(made.scenarios) == [1]
    replay = GenerateSettings("build a burger with cheese", replay=tmp_path / "out/exchanges.jsonl")
    assert generate_scenarios(replay, tmp_path / "again").scenarios == made.scenarios
    kept = [(tmp_path / name / "exchanges.jsonl").read_bytes() for name in ("out", "again")]
    assert kept[0] == kept[1]


def test_only_a_fence_around_the_whole_answer_is_removed():
    assert without_fence("```json\n[1]\n```") == "[1]"
    assert without_fence("Here: ```json\n[1]\n```") == "Here: ```json\n[1]\n```"
    assert without_fence("```") == "```"


SETTINGS = GenerateSettings("loose_packing", 2, "http://localhost:1/v1#tiny")


def contents(folder):
    """The bytes of the files that must be the same."""
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*.json*")) if p.name != ".lock"
    }


def test_an_interrupted_command_goes_on_without_asking_again(tmp_path):
    model = Model("no", text(GOOD), ModelError("gone"))
    with pytest.raises(ModelError, match="gone"):
        generate_scenarios(SETTINGS, tmp_path / "out", chat=model)
    assert len(lines_of(tmp_path / "out/exchanges.jsonl")) == 2
    interrupted = Model(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        generate_scenarios(SETTINGS, tmp_path / "out", chat=interrupted)
    with (tmp_path / "out/exchanges.jsonl").open("ab") as file:
        file.write(b'{"answer": "unfini')  # of a killed process
    rest = Model(text(OTHER))
    made = generate_scenarios(SETTINGS, tmp_path / "out", chat=rest)
    assert len(rest.asked) == 1
    assert list(made.scenarios) == [1, 2]
    before = contents(tmp_path / "out")
    again = generate_scenarios(SETTINGS, tmp_path / "out", chat=Model(AssertionError("asked again")))
    assert again.scenarios == made.scenarios
    assert contents(tmp_path / "out") == before


def test_a_replay_gives_the_same_bytes_without_the_model(tmp_path):
    made = generate_scenarios(SETTINGS, tmp_path / "out", chat=Model("no", text(GOOD), text(OTHER)))
    replay = GenerateSettings("loose_packing", 2, replay=tmp_path / "out/exchanges.jsonl")
    again = generate_scenarios(replay, tmp_path / "again")
    assert again.scenarios == made.scenarios
    for name in ("exchanges.jsonl", *(f"scenarios/{path.name}" for path in made.files.values())):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    more = GenerateSettings("loose_packing", 3, replay=tmp_path / "out/exchanges.jsonl")
    with pytest.raises(ModelError, match="no answer to scenario 3, try 1"):
        generate_scenarios(more, tmp_path / "more")


def test_a_changed_exchange_is_detected(tmp_path):
    generate_scenarios(SETTINGS, tmp_path / "out", chat=Model("no", text(GOOD), text(OTHER)))
    path = tmp_path / "out/exchanges.jsonl"
    path.write_text(path.read_text().replace("red apple", "red brick"))
    with pytest.raises(RecordError, match="does not match the lines before it"):
        read_exchanges(path)
    with pytest.raises(InvalidInputError, match="is not a file"):
        read_exchanges(tmp_path / "absent.jsonl")


def test_another_command_in_the_same_folder_is_refused(tmp_path):
    generate_scenarios(SETTINGS, tmp_path / "out", chat=Model(text(GOOD), text(OTHER)))
    other = GenerateSettings("loose_packing", 2, "http://localhost:1/v1#large")
    with pytest.raises(RunConflictError, match=r"settings\.model"):
        generate_scenarios(other, tmp_path / "out", chat=Model(text(GOOD)))
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/thesis.txt").write_text("mine")
    with pytest.raises(RunConflictError, match=r"thesis\.txt"):
        generate_scenarios(SETTINGS, tmp_path / "foreign", chat=Model(text(GOOD)))


def test_a_name_of_a_model_becomes_a_harmless_file_name(tmp_path):
    named = changed(["scenario_name"], "Élise's lunch (50%): a, b. - c")
    made = generate_scenarios(
        GenerateSettings("loose_packing", 1, "http://localhost:1/v1#tiny"), tmp_path / "out", chat=Model(text(named))
    )
    assert made.files[1].name == "001_lise_s_lunch_50_a_b_c.json"


# ------------------------------------------------------------------------------------------------------- a real server
class Endpoint:
    """A chat endpoint whose replies are functions of the handler."""

    def __init__(self, *replies):
        self.replies, self.asked = list(replies), []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                outer.asked.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
                reply = outer.replies.pop(0) if len(outer.replies) > 1 else outer.replies[0]
                reply(self)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.server.server_port}/v1"
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()


def saying(answer, status=200):
    def reply(handler):
        body = json.dumps({"choices": [{"message": {"content": answer}}]}).encode()
        handler.send_response(status)
        handler.send_header("Content-Length", str(len(body)))
        handler.end_headers()
        handler.wfile.write(body)

    return reply


def silent(handler):
    time.sleep(4.0)


def dripping(handler):
    handler.send_response(200)
    handler.end_headers()
    for _ in range(100):
        try:
            handler.wfile.write(b" ")
            handler.wfile.flush()
        except OSError:
            return
        time.sleep(0.05)


def cut_off(handler):
    handler.send_response(200)
    handler.send_header("Content-Length", "10000")
    handler.end_headers()
    handler.wfile.write(b'{"choices": [')


@pytest.fixture
def serve():
    open_servers = []

    def start(*replies):
        open_servers.append(Endpoint(*replies))
        return open_servers[-1]

    yield start
    for endpoint in open_servers:
        endpoint.server.shutdown()
        endpoint.server.server_close()


def test_a_server_is_asked_with_plain_text_and_its_answers_become_scenarios(serve, tmp_path):
    endpoint = serve(saying("I cannot."), saying(text(GOOD)), saying(text(OTHER)))
    settings = GenerateSettings("loose_packing", 2, f"{endpoint.url}#tiny")
    made = generate_scenarios(settings, tmp_path / "out")
    assert list(made.scenarios) == [1, 2]
    assert [body["model"] for body in endpoint.asked] == ["tiny"] * 3
    assert all(isinstance(m["content"], str) for body in endpoint.asked for m in body["messages"])
    assert endpoint.asked[0]["max_tokens"] >= 1000


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        (silent, "no answer after 2 tries"),
        (dripping, r"no answer after 2 tries \(timeout: the answer was not complete after 1 s\)"),
        (cut_off, "no answer after 2 tries"),
        (saying("x", status=500), "no answer after 2 tries"),
        (saying("x", status=401), "Put the API key into the environment variable"),
        (saying("x", status=400), "HTTP 400"),
    ],
)
def test_a_slow_or_broken_server_is_one_clear_message_and_keeps_what_was_answered(serve, tmp_path, reply, said):
    endpoint = serve(saying(text(GOOD)), reply)
    chat = ChatEndpoint(endpoint.url, "tiny", timeout_s=1.5, deadline_s=1.0, tries=2, sleep=lambda _: None)
    with pytest.raises(ModelError, match=said) as caught:
        generate_scenarios(SETTINGS, tmp_path / "out", chat=chat)
    assert "\n" not in str(caught.value)
    assert len(lines_of(tmp_path / "out/exchanges.jsonl")) == 1
    made = generate_scenarios(SETTINGS, tmp_path / "out", chat=ScriptedChat(lambda _: text(OTHER), name="tiny"))
    assert list(made.scenarios) == [1, 2]
