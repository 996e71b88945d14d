"""Does it know what it fails to do: questions about decisive moments, and answers beside deeds."""

from __future__ import annotations

import json
import shutil

import pytest
from tests.vqa.small import SIZE, small_run

from betterbench.cli.main import main
from betterbench.diagnosis import diagnose_run
from betterbench.errors import InvalidInputError
from betterbench.evaluation.figures.views import ViewRenderer
from betterbench.llm import ScriptedChat
from betterbench.vqa.asking import ask_set
from betterbench.vqa.decisive import DecisiveOptions, make_decisive_set
from betterbench.vqa.episode import episode_of
from betterbench.vqa.freeform import ModelText, StateClaim, describe_images, facts_of, parsed_texts, why_dropped
from betterbench.vqa.knowing import KnowledgeStanding, knowledge_of
from betterbench.vqa.moment import Moment

pytestmark = [pytest.mark.physics, pytest.mark.render]

OPTIONS = DecisiveOptions(size=SIZE, quality="fast")


@pytest.fixture(scope="module")
def failing(tmp_path_factory):
    """A policy that goes by color, on a scene with a look-alike, and on one that it solves."""
    return small_run("zoo:color", tmp_path_factory.mktemp("know") / "run", {"morning_coffee": ("O1", "L4")})


@pytest.fixture(scope="module")
def decisive(failing, tmp_path_factory):
    return make_decisive_set(
        failing, diagnose_run(failing), tmp_path_factory.mktemp("know") / "set", OPTIONS,
        open_photos=lambda: ViewRenderer(failing, size=SIZE, quality="fast"),
    )  # fmt: skip


def answered(asked, tmp_path, reply, name):
    replies = iter([reply(q) for q in asked.questions])
    return ask_set(asked, ScriptedChat(lambda _: next(replies), name=name), tmp_path / f"{name}.jsonl", at_once=1)


def test_decisive_moments_are_asked_about_twice_with_other_words(failing, decisive):
    by_question = {}
    for q in decisive.questions:
        by_question.setdefault(q.id.rpartition("-")[0], []).append(q)
    assert {q.role for q in decisive.questions} >= {"asked", "where", "under", "exists"}
    for first, second in by_question.values():
        assert first.text != second.text
        assert first.answer == second.answer
        if first.options:
            assert first.options.index(first.answer) != second.options.index(second.answer)
    label = next(t for t in diagnose_run(failing).trials if not t.success)
    under = next(q for q in decisive.questions if q.role == "under" and q.source.condition == label.variation)
    assert under.answer == label.first_attempt_kind


def test_answers_about_another_run_are_refused_and_nothing_is_kept(failing, decisive, tmp_path, capsys):
    """Two policies play trials of the same names: answers about the frames of one say nothing of the other."""
    answered(decisive, tmp_path, lambda q: q.reply, "wise")
    asked = tmp_path / "asked"
    shutil.copytree(decisive.path, asked)
    told = json.loads((asked / "set.json").read_text())
    told["records"] = dict.fromkeys(told["records"], "0" * 64)
    (asked / "set.json").write_text(json.dumps(told))
    before = {path: path.read_bytes() for path in failing.path.rglob("knowledge.json")}
    words = ["diagnose", str(failing.path), "--answers", str(tmp_path / "wise.jsonl"), "--questions", str(asked)]
    assert main(words) == 2
    assert "asks about another record of morning_coffee/" in " ".join(capsys.readouterr().err.split())
    assert before == {path: path.read_bytes() for path in failing.path.rglob("knowledge.json")}


def test_who_knows_all_and_who_knows_nothing(failing, decisive, tmp_path):
    diagnosis = diagnose_run(failing)
    wise = knowledge_of(diagnosis, decisive, answered(decisive, tmp_path, lambda q: q.reply, "wise"))
    failed = [t for t in wise.trials if not t.success]
    assert failed
    assert all(t.standing is KnowledgeStanding.KNOWS_AND_DOES_NOT for t in failed)
    assert all(t.standing is KnowledgeStanding.KNOWS_AND_DOES for t in wise.trials if t.success)
    fool = knowledge_of(diagnosis, decisive, answered(decisive, tmp_path, lambda _: "?", "fool"))
    assert {t.standing for t in fool.trials} <= {
        KnowledgeStanding.DOES_NOT_KNOW,
        KnowledgeStanding.DOES_WITHOUT_KNOWING,
    }
    assert sum(x.n for x in fool.labels) == len(diagnosis.trials)


def test_the_verbs_put_answers_beside_deeds_and_on_the_page(failing, decisive, tmp_path, capsys):
    answered(decisive, tmp_path, lambda q: q.reply, "wise")
    line = ["diagnose", str(failing.path), "--answers", str(tmp_path / "wise.jsonl"), "--questions", str(decisive.path)]
    assert main([*line, "--json"]) == 0
    known = json.loads(capsys.readouterr().out)["knowledge"]
    assert known["model"] == "wise"
    assert sum(x["counts"]["knows_and_does_not"] for x in known["labels"]) >= 1
    assert main(line) == 0
    assert "it knew the right decision in 1 (somebody" in " ".join(capsys.readouterr().out.split())
    assert main(["report", str(failing.path), "--films", "0", "--out", str(tmp_path / "page")]) == 0
    page = (tmp_path / "page" / "index.html").read_text()
    assert "Does it know what it fails to do?" in page
    assert "wise" in page


def test_a_set_of_another_kind_is_refused(failing, made, tmp_path):
    answers = answered(made, tmp_path, lambda q: q.reply, "x")
    with pytest.raises(InvalidInputError, match="asks about no decisive moment"):
        knowledge_of(diagnose_run(failing), made, answers)


@pytest.fixture(scope="module")
def moment(run, source):
    record = run.read_record("fruit_lunch", "O2", 0)
    return Moment(episode_of(record), 0, source.photo(record, 0, "front").view)


@pytest.mark.parametrize(
    ("text", "claims", "reason"),
    [
        ("There is a red block.", [("red block", "is visible", "")], None),
        ("The apple is not in the lunchbox.", [("apple", "is not in", "lunchbox")], None),
        ("The apple is in the lunchbox.", [("apple", "is in", "lunchbox")], "false"),
        ("There is a lemon.", [("lemon", "is visible", "")], "false"),
        ("The apple is on the orange.", [("apple", "is on", "orange")], "not decided by the state"),
        ("The apple and the orange.", [("apple", "is visible", "")], "names what it does not claim"),
        ("The apple is behind.", [("apple", "is visible", "")], "says more than it claims"),
        ("A big apple.", [("apple", "is visible", "")], "says what cannot be checked"),
        ("An apple.", [], "without a claim"),
    ],
)
def test_only_texts_that_the_state_proves_are_kept(moment, text, claims, reason):
    assert why_dropped(ModelText(text, tuple(StateClaim(*c) for c in claims)), moment, facts_of(moment)) == reason


def test_descriptions_are_kept_with_the_set_and_not_asked_for_twice(run, made, source):
    reply = {"texts": [{"text": "There is no sponge.", "claims": [{"x": "sponge", "says": "is absent", "y": ""}]}]}
    asked = []

    def say(messages):
        asked.append(messages)
        return "```json\n" + json.dumps(reply) + "\n```" if len(asked) % 2 else "I would rather not."

    first = describe_images(run, made, ScriptedChat(say, name="poet"), source, count=4)
    again = describe_images(run, made, ScriptedChat(say, name="poet"), source, count=4)
    assert len(asked) == 4
    assert first == again
    assert first.kept + sum(first.dropped.values()) == 4
    lines = [json.loads(line) for line in (made.path / "descriptions.jsonl").read_text().splitlines()]
    assert len(lines) == first.kept
    assert parsed_texts(json.dumps(reply))[0].claims == (StateClaim("sponge", "is absent"),)
