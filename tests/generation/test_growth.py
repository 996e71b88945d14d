"""A suite grows to N certified tasks under quotas, without near-duplicates, and resumes with the same bytes."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.daily import others_slow
from tests.generation.examples import text
from tests.generation.test_building import failing, proven

from betterbench.certification.certificate import CLAUSES, Clause, TrialCertificate
from betterbench.errors import InvalidInputError, ModelError, RecordError, RunConflictError, UnknownNameError
from betterbench.generation.building import attempts as attempts_module
from betterbench.generation.building.job import BuildItem
from betterbench.generation.building.result import Attempt, Failure, Result, Settings
from betterbench.generation.folder import GenerateSettings
from betterbench.generation.grammar import write_scenarios
from betterbench.generation.growth import job as job_module
from betterbench.generation.growth.job import GrowProgress, GrowSettings, grow_suite, prepare_growth
from betterbench.generation.growth.likeness import key_of_choice, key_of_scenario, key_of_task
from betterbench.generation.growth.quotas import parse_quota, quotas_from_form
from betterbench.generation.growth.result import Growth
from betterbench.generation.scenario_form import answer_to_json
from betterbench.jobs.outputs import OutputFolder
from betterbench.report.pages.growth_page import bars_of, cures_of, refusal_groups, write_growth_page
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.tasks import Axis, get_task, read_suite_folder, suite_tasks, task_from_json
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.vqa.llm import ScriptedChat

pytestmark = pytest.mark.usefixtures("indexed_once")

AXES = {
    "loose_packing": "LRROOTT",
    "patterned_arrangement": "LLRRO",
    "recursive_stacking": "LLRT",
}
"""Axes of the variations of the tasks in these tests, "LROT" for the other templates."""
SLOW = {"logical_assembly": 400, "constrained_positioning": 120}
"""Steps of the expert, 240 for the other templates."""


def trial(task: str, condition: str, steps: int) -> TrialCertificate:
    clauses = {letter: Clause(True) for letter in CLAUSES}
    return TrialCertificate(task, condition, False, 0, clauses, steps, 900, 0.0, 0.0, 0.5, 1.0)


def built(item: BuildItem, *, refused: bool = False) -> Result:
    """The result of a scenario, certified unless it is refused with clause (b)."""
    form = json.loads(item.scenario)
    names = [f"{letter}{n}" for n, letter in enumerate(AXES.get(form["template"], "LROT"), start=1)]
    failures = (Failure("train1", (0,), "b", CLAUSES["b"], "released 12 mm above"),)
    attempts = (Attempt("as described", "a training condition is not certified", failures),)
    if refused:
        attempts += (Attempt("other slots", "a training condition is not certified", failures),)
    return Result(
        schema_version=1,
        key="0" * 64,
        task_id=item.task_id,
        template=form["template"],
        title=form["name"],
        attempts=attempts if refused else (Attempt("as described", ""),),
        left_out=(),
        unbuilt=(),
        confounds=(),
        chosen=(),
        task=None if refused else {"version": 1, "training": [], "variations": [{"name": name} for name in names]},
        demonstrated=None,
        trials=() if refused else tuple(trial(item.task_id, n, SLOW.get(form["template"], 240)) for n in names),
    )


Grow = Callable[..., Growth]


@pytest.fixture
def grow(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Grow:
    """Grows a suite with results that are made up; ``refuse`` tells which scenarios fail by their template."""

    def run(
        settings: GrowSettings,
        *,
        out: str = "out",
        refuse: Callable[[BuildItem], bool] = lambda _: False,
        chat: ScriptedChat | None = None,
        stop_after: int | None = None,
    ) -> Growth:
        def build_items(items, out, *, settings, workers, on_stored, on_progress):
            results = tuple(built(item, refused=refuse(item)) for item in items)
            for number, result in enumerate(results, start=1):
                on_progress(job_module.JobProgress(number, len(items), result))
            return results

        told: list[GrowProgress] = []

        def progress(now: GrowProgress) -> None:
            told.append(now)
            if stop_after is not None and now.proposed >= stop_after:
                raise KeyboardInterrupt

        monkeypatch.setattr(job_module, "build_items", build_items)
        folder = tmp_path / out
        with OutputFolder(folder, "generate"):
            grown = grow_suite(prepare_growth(settings), folder, chat=chat, on_progress=progress)
        assert told[-1].accepted >= len(grown.accepted)
        return grown

    return run


def settings(until: int, *quotas: str, **changes: object) -> GrowSettings:
    return GrowSettings(until, quotas=tuple(map(parse_quota, quotas)), **changes)  # type: ignore[arg-type]


def templates_of(growth: Growth) -> Counter[str]:
    return Counter(task.result.template for task in growth.accepted)


def files(folder: Path) -> dict[str, bytes]:
    skipped = {"catalogue", ".lock"}
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not skipped & set(path.relative_to(folder).parts) and not path.name.endswith(".lock")
    }


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("template=loose_packing:20%", "template=loose_packing:20%"),
        ("axis=temporal:15%", "axis=temporal_extrapolation:15%"),
        ("axis=spatial_layout_shift:10%-40%", "axis=spatial_layout_shift:10%-40%"),
        ("context=kitchen:3-5", "context=kitchen:3-5"),
        ("context=kitchen table after dinner:1", "context=kitchen table after dinner:1"),
        ("difficulty=hard:10-30%", "difficulty=hard:10%-30%"),
    ],
)
def test_a_quota_is_read_and_shown(text: str, shown: str) -> None:
    assert str(parse_quota(text)) == shown
    assert parse_quota(shown) == parse_quota(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("loose_packing", "is not a quota"),
        ("template=loose_packing", "is not a quota"),
        ("colour=red:20%", "Unknown property of a quota 'colour'"),
        ("template=loose_paking:20%", "Did you mean 'loose_packing'"),
        ("axis=temporl:20%", "Did you mean 'temporal'"),
        ("difficulty=harder:1", "Did you mean 'hard'"),
        ("axis=temporal:3", "is a count"),
        ("template=loose_packing:120%", "is more than 100%"),
        ("template=loose_packing:2.5", "is not a whole number"),
        ("template=loose_packing:many", "is not an amount"),
        ("template=loose_packing:30%-10%", "is above the upper limit"),
        ("template=loose_packing:10%-3", "mixes a percentage and a count"),
        ("context=<b>:1", "the context contains '<'"),
    ],
)
def test_a_wrong_quota_is_one_clear_error(text: str, said: str) -> None:
    with pytest.raises((InvalidInputError, UnknownNameError)) as caught:
        parse_quota(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_has_the_same_quotas_as_the_options() -> None:
    form = {"template": {"loose_packing": "20%"}, "axis": {"temporal": "15%"}, "difficulty": {"hard": "1-3"}}
    texts = ("template=loose_packing:20%", "axis=temporal:15%", "difficulty=hard:1-3")
    assert quotas_from_form(form, where="quotas.yaml") == tuple(map(parse_quota, texts))
    with pytest.raises(InvalidInputError, match=r"quotas.yaml.*templates"):
        quotas_from_form({"templates": {}}, where="quotas.yaml")
    with pytest.raises(InvalidInputError, match=r"quotas.yaml"):
        quotas_from_form({"axis": {"temporal": 15}}, where="quotas.yaml")


@pytest.mark.parametrize(
    ("until", "quotas", "said"),
    [
        (
            10,
            ["template=loose_packing:60%", "template=patterned_arrangement:50%"],
            "need 11 tasks, but there are only 10",
        ),
        (10, ["context=kitchen:6", "context=pantry:5"], "need 11 tasks"),
        (10, ["axis=temporal:60%", "axis=spatial:50%"], "need 110% of the variations"),
        (10, ["template=loose_packing:1", "template=loose_packing:2"], "occurs 2 times"),
        (3, ["template=loose_packing:10%-20%"], "at least 1 and at most 0"),
        (10, ["difficulty=easy:0-3", "difficulty=medium:0-3", "difficulty=hard:0-3"], "allow only 9 tasks"),
        (40, ["template=recursive_stacking:20"], "the offline author has only 1 different goals for it"),
        (10, ["context=kitchn:1"], "Did you mean 'kitchen'"),
        (10, ["axis=recomposition:90%"], "at most"),
        (9_000, [], "the offline author has"),
        (10, ["template=loose_packing:0-0", "context=picnic:1"], "the offline author has only 0 different goals"),
    ],
)
def test_contradictions_are_found_before_any_work(until: int, quotas: list[str], said: str) -> None:
    with pytest.raises((InvalidInputError, UnknownNameError)) as caught:
        prepare_growth(settings(until, *quotas))
    assert said in str(caught.value)


def test_quotas_outside_of_the_template_are_refused() -> None:
    asked = dataclasses.replace(
        settings(3, "template=loose_packing:1"), author=GenerateSettings("patterned_arrangement")
    )
    with pytest.raises(UnknownNameError, match="template of this command"):
        prepare_growth(asked)


def test_the_suite_has_n_tasks_of_different_goals(grow: Grow) -> None:
    grown = grow(settings(20))
    assert (grown.stop, len(grown.accepted), len(grown.refused)) == ("reached", 20, 0)
    assert len({task.key for task in grown.accepted}) == 20
    assert len(templates_of(grown)) == len(TEMPLATES), "templates take turns"
    assert grown.suite is not None
    assert set(read_suite_folder(grown.suite).tasks) == {t.result.task_id for t in grown.accepted}
    assert "20 tasks are certified" in grown.reason


def test_one_certified_task_is_counted_in_the_singular(grow: Grow, tmp_path: Path) -> None:
    grown = grow(settings(1))
    assert grown.reason == "1 task is certified."
    page = write_growth_page(grown, tmp_path / "growth.html", seeds=1, cards={}).read_text(encoding="utf-8")
    assert "1 task is certified. It has" in page
    assert "1 scenario was built" in page


def test_quotas_are_filled(grow: Grow) -> None:
    asked = ("template=loose_packing:40%", "context=kitchen:5", "template=logical_assembly:0-1", "axis=temporal:22%")
    grown = grow(settings(20, *asked))
    assert grown.open_quotas == ()
    assert templates_of(grown)["loose_packing"] >= 8
    assert templates_of(grown)["logical_assembly"] <= 1
    assert sum(task.context == "kitchen" for task in grown.accepted) >= 5
    temporal = sum(t.variations[Axis.TEMPORAL_EXTRAPOLATION.value] for t in grown.accepted)
    assert temporal / grown.variations >= 0.22


def test_a_measured_difficulty_is_steered_and_kept(grow: Grow) -> None:
    """The expectation is wrong at first: tasks that turn out too easy are set aside once their places are gone."""
    grown = grow(settings(6, "difficulty=hard:2", "difficulty=easy:1-1"))
    levels = Counter(task.difficulty for task in grown.accepted)
    assert grown.stop == "reached"
    assert levels["hard"] >= 2
    assert levels["easy"] == 1
    assert all(task.set_aside for task in grown.tasks if task not in grown.accepted)


def test_a_refused_scenario_is_replaced_and_its_quota_still_filled(grow: Grow) -> None:
    seen: Counter[str] = Counter()

    def refuse(item: BuildItem) -> bool:
        template = json.loads(item.scenario)["template"]
        seen[template] += 1
        return template == "loose_packing" and seen[template] <= 2

    grown = grow(settings(8, "template=loose_packing:4"), refuse=refuse)
    assert len(grown.refused) == 2
    assert templates_of(grown)["loose_packing"] >= 4
    assert len(grown.accepted) == 8


def test_growth_ends_when_the_grammar_is_used_up_and_names_the_open_quotas(grow: Grow) -> None:
    def refuse(item: BuildItem) -> bool:
        return json.loads(item.scenario)["template"] == "recursive_stacking"

    grown = grow(settings(4, "template=recursive_stacking:1", "template=loose_packing:3"), refuse=refuse)
    assert grown.stop == "exhausted"
    assert len(grown.accepted) == 3
    assert [q.quota for q in grown.open_quotas] == ["template=recursive_stacking:1"]
    assert "no new scenario is left" in grown.reason
    assert "template=recursive_stacking:1 (has 0)" in grown.reason


def test_growth_ends_after_the_largest_number_of_attempts_and_goes_on_with_more(grow: Grow) -> None:
    grown = grow(settings(5, max_attempts=7), refuse=lambda item: not item.task_id.startswith("packing"))
    assert grown.stop == "attempts"
    assert len(grown.tasks) + len(grown.refused) == 7
    assert "after 7 attempts" in grown.reason
    more = grow(settings(5, max_attempts=40), refuse=lambda item: not item.task_id.startswith("packing"))
    assert more.stop == "reached"
    assert more.proposals[:7] == grown.proposals


@pytest.mark.parametrize("stop_after", [1, 5, 9])
def test_an_interrupted_growth_ends_with_the_same_files(grow: Grow, tmp_path: Path, stop_after: int) -> None:
    asked = settings(9, "template=loose_packing:30%", "difficulty=hard:1")
    refuse = lambda item: "2" in item.task_id  # noqa: E731
    whole = grow(asked, out="whole", refuse=refuse)
    with pytest.raises(KeyboardInterrupt):
        grow(asked, out="parts", refuse=refuse, stop_after=stop_after)
    resumed = grow(asked, out="parts", refuse=refuse)
    assert [t.result for t in resumed.accepted] == [t.result for t in whole.accepted]
    assert files(tmp_path / "parts") == files(tmp_path / "whole")
    grow(asked, out="parts", refuse=refuse)
    assert files(tmp_path / "parts") == files(tmp_path / "whole"), "a finished growth stays as it is"


def test_a_larger_number_keeps_the_tasks(grow: Grow) -> None:
    few = grow(settings(5, "template=loose_packing:40%"))
    more = grow(settings(9, "template=loose_packing:40%"))
    assert [t.result for t in more.accepted][:5] == [t.result for t in few.accepted]
    assert len(more.accepted) == 9


def test_a_smaller_number_ends_with_the_first_tasks(grow: Grow) -> None:
    """For example to end early: what the larger number has drawn is used, and no more is drawn."""
    refuse = lambda item: "stacking" in item.task_id  # noqa: E731
    many = grow(settings(9), refuse=refuse)
    few = grow(settings(4), refuse=refuse)
    assert [t.result for t in few.accepted] == [t.result for t in many.accepted][:4]
    assert [p.number for p in few.proposals] == [p.number for p in many.proposals][: len(few.proposals)]
    assert grow(settings(9), refuse=refuse).accepted == many.accepted


def test_other_settings_and_changed_proposals_are_refused(grow: Grow, tmp_path: Path) -> None:
    grow(settings(3))
    with pytest.raises(RunConflictError, match="quotas"):
        grow(settings(3, "template=loose_packing:1"))
    file = tmp_path / "out" / "proposals.jsonl"
    file.write_text(file.read_text().replace("loose_packing", "loose_picking"))
    with pytest.raises((RecordError, RunConflictError)):
        grow(settings(3))


def test_near_duplicates_of_another_suite_are_left_out(grow: Grow) -> None:
    keys = {key_of_task(get_task(task)) for task in suite_tasks("better60")}
    assert keys & {task.key for task in grow(settings(60), out="all").accepted}
    grown = grow(settings(60, unlike=("better60",)), out="unlike")
    assert grown.known_goals >= 8
    assert not keys & {task.key for task in grown.accepted}


def test_with_distinct_colors_more_tasks_are_possible(grow: Grow) -> None:
    author = GenerateSettings("recursive_stacking")
    with pytest.raises(InvalidInputError, match="--distinct colors"):
        prepare_growth(GrowSettings(3, author))
    grown = grow(GrowSettings(3, author, distinct="colors"))
    assert len({task.key for task in grown.accepted}) == 3


@pytest.mark.parametrize("template", others_slow(sorted(TEMPLATES), 3))
def test_scenario_grammar_and_task_have_the_same_key(template: str, monkeypatch, tmp_path: Path) -> None:
    from betterbench.generation.building.job import build_suite

    monkeypatch.setattr(attempts_module, "prove", proven(failing(), []))
    monkeypatch.setattr(attempts_module, "badly_framed", lambda *_, **__: ())
    scenario = write_scenarios(template, 1, seed=2)[0]
    (result,) = build_suite([scenario], tmp_path / "out", name="kitchen", settings=Settings(1, 2)).results
    assert result.task is not None
    kinds = {
        group: [(o.tags[0].replace(" ", "_"), o.tags[1]) for o in objects] for group, objects in scenario.groups.items()
    }
    with Catalogue(tmp_path / "out" / "catalogue") as catalogue:
        for distinct in ("categories", "colors"):
            key = key_of_choice(template, kinds, distinct)
            assert key_of_scenario(scenario, catalogue, distinct) == key
            assert key_of_task(task_from_json(result.task), distinct) == key


def answers(*scenarios) -> ScriptedChat:
    """A model that writes scenarios one after the other."""
    left = iter(scenarios)
    return ScriptedChat(lambda _: text(answer_to_json(next(left))), name="good")


def test_a_model_writes_the_scenarios_and_its_near_duplicates_are_left_out(grow: Grow, tmp_path: Path) -> None:
    author = GenerateSettings("loose_packing", model="http://localhost:1/v1#good")
    first, second = write_scenarios("loose_packing", 2, seed=0)
    others = [s for s in write_scenarios("loose_packing", 400, seed=0) if set_of(s) == set_of(first) and s != first]
    asked = GrowSettings(2, author)
    grown = grow(asked, chat=answers(first, others[0], second))
    assert [p.outcome for p in grown.proposals] == ["drawn", "near_duplicate", "drawn"]
    assert grown.near_duplicates == 1
    assert grown.proposals[1].problem == f"has the goal of {grown.tasks[0].result.task_id}"
    silent = ScriptedChat(lambda _: pytest.fail("the model is asked again"), name="good")
    assert grow(asked, chat=silent).accepted == grown.accepted
    replay = dataclasses.replace(author, model="offline", replay=tmp_path / "out" / "exchanges.jsonl")
    assert grow(GrowSettings(2, replay), out="again").accepted == grown.accepted


def set_of(scenario) -> set[str]:
    return {o.tags[0] for objects in scenario.groups.values() for o in objects}


def test_a_context_is_requested_of_the_model_and_required(grow: Grow) -> None:
    questions: list[str] = []
    scenarios = iter(write_scenarios("loose_packing", 3, seed=0))

    def answer(messages) -> str:
        questions.append(messages[-1]["content"])
        scenario = next(scenarios)
        context = "moon base" if len(questions) > 1 else scenario.context
        return text(answer_to_json(dataclasses.replace(scenario, context=context)))

    author = GenerateSettings("loose_packing", model="http://localhost:1/v1#good")
    asked = GrowSettings(1, author, quotas=(parse_quota("context=moon base:1"),))
    grown = grow(asked, chat=ScriptedChat(answer, name="good"))
    assert "The scene_context must be:\nmoon base" in questions[0]
    assert "Write 'moon base'" in questions[1]
    assert grown.accepted[0].context == "moon base"


def test_a_model_that_writes_nothing_new_is_exhausted(grow: Grow) -> None:
    author = GenerateSettings("loose_packing", model="http://localhost:1/v1#shy", tries=1)
    grown = grow(GrowSettings(2, author), chat=ScriptedChat(lambda _: "I cannot.", name="shy"))
    assert grown.stop == "exhausted"
    assert [p.outcome for p in grown.proposals] == ["refused"] * 5
    assert grown.suite is None


def test_an_unreachable_model_ends_with_its_error_and_the_growth_resumes(grow: Grow, tmp_path: Path) -> None:
    scenarios = write_scenarios("loose_packing", 2, seed=0)
    author = GenerateSettings("loose_packing", model="http://localhost:1/v1#good")
    left = iter(scenarios[:1])

    def broken(_) -> str:
        for scenario in left:
            return text(answer_to_json(scenario))
        raise ModelError("The model cannot be reached.")

    with pytest.raises(ModelError):
        grow(GrowSettings(2, author), chat=ScriptedChat(broken, name="good"))
    grown = grow(GrowSettings(2, author), chat=answers(scenarios[1]))
    assert len(grown.accepted) == 2


def test_the_same_growth_gives_the_same_bytes_and_builds_nothing_twice(monkeypatch, tmp_path: Path) -> None:
    """With the real building and pattern, and a proof without a simulator."""
    runs: list[str] = []
    monkeypatch.setattr(attempts_module, "prove", proven(failing(), runs))
    monkeypatch.setattr(attempts_module, "badly_framed", lambda *_, **__: ())
    asked = settings(3, "template=loose_packing:1", build=Settings(1, 2))

    def run(out: str, stop_after: int | None = None) -> None:
        finished = 0

        def told(progress: GrowProgress) -> None:
            nonlocal finished
            finished += progress.last is not None
            if finished == stop_after:
                raise KeyboardInterrupt

        with OutputFolder(tmp_path / out, "generate"):
            grow_suite(prepare_growth(asked), tmp_path / out, on_progress=told)

    run("whole")
    assert len(runs) == 3
    with pytest.raises(KeyboardInterrupt):
        run("parts", stop_after=2)
    run("parts")
    assert len(runs) == 6
    assert files(tmp_path / "parts") == files(tmp_path / "whole")


def test_the_page_shows_quotas_refusals_by_clause_and_cures(grow: Grow, tmp_path: Path) -> None:
    refused = {"packing_a_picnic", "setting_up_a_home_office"}
    grown = grow(
        settings(12, "template=loose_packing:25%", "axis=temporal:20%"), refuse=lambda item: item.task_id in refused
    )
    groups = refusal_groups(grown.refused)
    assert {group.title for group in groups} <= {f"clause (b) failed: {CLAUSES['b']}"}
    assert [(c.change, c.tried, c.helped) for c in cures_of(grown)] == (
        [("other slots", len(grown.refused), 0)] if grown.refused else []
    )
    bars = bars_of(grown)
    marked = {bar.value: bar for bar in bars["template"] if bar.least is not None}
    assert marked["loose packing"].least == pytest.approx(25.0)
    assert sum(bar.percent for bar in bars["template"]) == pytest.approx(100.0)
    assert sum(bar.percent for bar in bars["axis"]) == pytest.approx(100.0)
    page = write_growth_page(grown, tmp_path / "growth.html", seeds=2, cards={}).read_text()
    assert "12 tasks are certified. They have" in page
    assert page.count('class="fill"') == sum(map(len, bars.values()))
    assert f"{grown.near_duplicates:,} scenarios were left out as near-duplicates" in page
    for result in grown.refused:
        assert result.task_id in page
    assert "<script" not in page
