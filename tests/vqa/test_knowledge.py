"""Does it know what it fails to do: questions about decisive moments, and answers beside deeds."""

from __future__ import annotations

import json
import shutil

import pytest
from tests.looping import each
from tests.resealing import rewrite
from tests.vqa.small import SIZE, small_run

from betterbench.cli.main import main
from betterbench.diagnosis import diagnose_run
from betterbench.errors import InvalidInputError, RecordError
from betterbench.evaluation.figures.views import ViewRenderer
from betterbench.json_form import sealed_form
from betterbench.records import RunFolder
from betterbench.vqa.asking import ask_set, read_answers
from betterbench.vqa.decisive import DecisiveOptions, make_decisive_set
from betterbench.vqa.episode import episode_of
from betterbench.vqa.freeform import ModelText, StateClaim, describe_images, facts_of, parsed_texts, why_dropped
from betterbench.vqa.knowing import KnowledgeStanding, knowledge_of, read_knowledge, store_knowledge
from betterbench.vqa.llm import ScriptedChat
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
    (asked / "set.json").write_text(json.dumps(sealed_form(told)))
    before = {path: path.read_bytes() for path in failing.path.rglob("knowledge.json")}
    words = ["diagnose", str(failing.path), "--answers", str(tmp_path / "wise.jsonl"), "--questions", str(asked)]
    assert main(words) == 2
    assert "is not the record from which the set was created" in " ".join(capsys.readouterr().err.split())
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
    assert "it knew the right decision in 1 (expected without the image" in " ".join(capsys.readouterr().out.split())
    assert main(["report", str(failing.path), "--films", "0", "--out", str(tmp_path / "page")]) == 0
    page = (tmp_path / "page" / "index.html").read_text()
    assert "Knowledge of a model and behavior of the policy" in page
    assert "wise" in page


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda counts: counts.pop("not_asked"), "must have exactly one count for each standing"),
        (lambda counts: counts.update(guessed=0), "must have exactly one count for each standing"),
        (lambda counts: counts.update(not_asked=7), "add up to 8 trials, expected 1"),
        (lambda counts: counts.update(not_asked=-1), "must have exactly one count for each standing"),
    ],
)
def test_stored_knowledge_that_does_not_add_up_is_refused(change, problem, failing, decisive, tmp_path):
    diagnosis, whole = diagnose_run(failing), answered(decisive, tmp_path, lambda q: q.reply, "wise")
    run = tmp_path / "run"
    shutil.copytree(failing.path, run)
    store_knowledge(RunFolder.open(run), knowledge_of(diagnosis, decisive, whole))
    rewrite(run / "knowledge.json", lambda form: change(form["labels"][0]["counts"]))
    with pytest.raises(RecordError, match=problem):
        read_knowledge(RunFolder.open(run))


def test_what_was_not_answered_yet_is_not_asked_and_not_kept(failing, decisive, tmp_path, capsys):
    diagnosis, whole = diagnose_run(failing), answered(decisive, tmp_path, lambda q: q.reply, "wise")
    known = knowledge_of(diagnosis, decisive, whole)
    assert known.is_complete
    file = tmp_path / "wise.jsonl"
    line = ["diagnose", str(failing.path), "--answers", str(file), "--questions", str(decisive.path)]
    assert main(line) == 0
    kept = (failing.path / "knowledge.json").read_bytes()
    lines = file.read_text().splitlines()
    failed = next(t for t in diagnosis.trials if not t.success).trial_id
    some = [x for x, q in zip(lines[1:], decisive.questions, strict=True) if q.source.trial != failed]
    file.write_text("\n".join(["\ufeff" + lines[0], *some]) + "\n", encoding="utf-8")
    part = knowledge_of(diagnosis, decisive, read_answers(file, decisive))
    assert (part.asked, part.answered) == (known.asked, len(some))
    assert not part.is_complete
    assert {t.standing for t in part.trials if not t.success} == {KnowledgeStanding.NOT_ASKED}
    assert all(t.standing is KnowledgeStanding.KNOWS_AND_DOES for t in part.trials if t.success)
    capsys.readouterr()
    assert main(line) == 0
    told = capsys.readouterr()
    missing = known.asked - len(some)
    assert f"{missing} of {known.asked} questions about this run have no answer" in " ".join(told.out.split())
    assert "Not stored for the report" in told.err
    assert (failing.path / "knowledge.json").read_bytes() == kept
    file.write_text(lines[0] + "\n")
    with pytest.raises(InvalidInputError, match="'wise': the file contains no answer to a question"):
        knowledge_of(diagnosis, decisive, read_answers(file, decisive))


def test_chance_is_what_the_words_alone_give_away(failing, decisive, tmp_path, monkeypatch):
    diagnosis, whole = diagnose_run(failing), answered(decisive, tmp_path, lambda q: q.reply, "wise")
    guessed = {t.key: t.chance for t in knowledge_of(diagnosis, decisive, whole).trials}
    monkeypatch.setattr("betterbench.vqa.knowing.blind_right", lambda questions, _: [True] * len(questions))
    assert {t.chance for t in knowledge_of(diagnosis, decisive, whole).trials} == {1.0}
    monkeypatch.setattr("betterbench.vqa.knowing.blind_right", lambda questions, _: [False] * len(questions))
    least = {t.key: t.chance for t in knowledge_of(diagnosis, decisive, whole).trials}
    assert all(0.0 < least[key] <= guessed[key] <= 1.0 for key in guessed)


@pytest.mark.parametrize("model", ["", " ", "a\nb", "x" * 201, "a\x1b[2J"])
def test_a_name_that_no_table_can_show_is_refused(decisive, tmp_path, model):
    file = tmp_path / "answers.jsonl"
    file.write_text(json.dumps({"model": model, "set_sha256": decisive.sha256}) + "\n")
    with pytest.raises(RecordError, match=r"line 1: model: .*printable") as error:
        read_answers(file, decisive)
    assert "\n" not in str(error.value)


def test_more_answers_than_questions_and_a_missing_set_are_one_line(failing, decisive, tmp_path, capsys):
    file = tmp_path / "answers.jsonl"
    head = json.dumps({"model": "x", "set_sha256": decisive.sha256})
    many = (json.dumps({"id": str(i), "text": "Yes"}) for i in range(len(decisive.questions) + 1))
    file.write_text("\n".join([head, *many]))
    with pytest.raises(InvalidInputError, match=r"answers to the [\d,]+ questions of"):
        read_answers(file, decisive)
    assert main(["diagnose", str(failing.path), "--answers", str(file)]) == 2
    assert "contains no question set" in " ".join(capsys.readouterr().err.split())


def test_a_set_of_another_kind_is_refused(failing, made, tmp_path):
    answers = answered(made, tmp_path, lambda q: q.reply, "x")
    with pytest.raises(InvalidInputError, match="contains no questions about this run"):
        knowledge_of(diagnose_run(failing), made, answers)


@pytest.fixture(scope="module")
def moment(run, source):
    record = run.read_record("fruit_lunch", "O2", 0)
    return Moment(episode_of(record), 0, source.photo(record, 0, "front").view)


@each(
    "text, claims, reason",
    [
        ("There is a red block.", [("red block", "is visible", "")], None),
        ("The apple is not in the lunchbox.", [("apple", "is not in", "lunchbox")], None),
        ("The apple is in the lunchbox.", [("apple", "is in", "lunchbox")], "false"),
        ("There is a lemon.", [("lemon", "is visible", "")], "false"),
        ("The apple is on the orange.", [("apple", "is on", "orange")], "cannot be decided from the state"),
        ("The apple and the orange.", [("apple", "is visible", "")], "names objects without a claim"),
        ("The apple is behind.", [("apple", "is visible", "")], "contains words without a claim"),
        ("A big apple.", [("apple", "is visible", "")], "contains words that cannot be checked"),
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


def test_knowing_is_set_against_doing_by_axis_variation_and_failure_mode(failing, decisive, tmp_path, capsys):
    diagnosis = diagnose_run(failing)
    wise = knowledge_of(diagnosis, decisive, answered(decisive, tmp_path, lambda q: q.reply, "wise"))
    groups = {group.name: group for group in wise.groups}
    failed = next(t for t in diagnosis.trials if not t.success)
    assert {group.kind for group in wise.groups} == {"all", "axis", "variation", "label"}
    assert {failed.axis, f"{failed.task}/{failed.variation}", failed.label.value, "all"} <= groups.keys()
    assert (groups["all"].knows.k, groups["all"].does.k, groups["all"].trials) == (2, 1, 2)
    assert groups[failed.label.value].known_failures == 1
    assert groups["all"].to_json()["corrected"] == pytest.approx(1.0)
    assert {group.verdict.value for group in wise.groups} == {"not decided"}  # two trials decide nothing
