"""Generate the documentation pages about tasks: an index, a page per task, and the templates."""

from __future__ import annotations

import importlib
import inspect
import json
from collections import Counter
from collections.abc import Sequence

from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.diagnosis.measures.power_matrix import Key, power_matrix_of
from betterbench.report.pages.not_shown import not_shown
from betterbench.statistics import percent
from betterbench.tasks import (
    TEMPLATES,
    Axis,
    Condition,
    Operation,
    Support,
    TargetRegion,
    Task,
    Template,
    Variation,
    template_to_json,
    training_distribution_of,
)
from betterbench.tasks.authoring.registry import notes_of, suite_of
from betterbench.tasks.interventions import vary
from betterbench.tasks.judging.harm import NO_HARM
from betterbench.tasks.relations import RELATIONS
from construct_validity import validity_text

LETTERS = tuple(axis.letter for axis in Axis)
HEADINGS = ("Randomizations", "Success", "Premise")
"""The headings that a task's docstring may have."""


def index_page(tasks: Sequence[Task]) -> str:
    """Return the index of all tasks."""
    rows = []
    for task in tasks:
        counts = Counter(v.axis.letter for v in task.variations)
        cells = [f"[{task.title}](tasks/{task.id}.md)", f"`{task.id}`", _template_link(task.template, "")]
        cells += [str(len(task.training)), str(len(task.variations)), *(str(counts[c] or "–") for c in LETTERS)]
        rows.append(_row(cells))
    suite = [task for task in tasks if suite_of(task.id) == "better60"]
    total = Counter(v.axis.letter for t in suite for v in t.variations)
    sums = [str(sum(len(t.training) for t in suite)), str(sum(total.values())), *(str(total[c]) for c in LETTERS)]
    axes = ", ".join(f"{axis.value.replace('_', ' ')} ({axis.letter})" for axis in Axis)
    return "\n".join(
        [
            "# Tasks and variations",
            "",
            (
                "Each task has a training distribution, in which words, slots and orders are correlated more closely "
                "than the task requires. Its variations break these correlations. A variation is a training condition "
                "with one intervention. With the same seed, everything else is identical, bit for bit. The last four "
                f"columns count the variations by axis: {axes}."
            ),
            "",
            _row(["task", "id", "template", "training conditions", "variations", *LETTERS]),
            _row(["---"] * 3 + ["---:"] * (2 + len(LETTERS))),
            *rows,
            _row(["suite better60", "", "", *sums]),
            "",
            "Training scene and test scene of every variation for seed 0, with the changes outlined:",
            "",
            "![all variations, training scene beside test scene](pictures/contact_sheet.jpg)",
            "",
            (
                "`better show TASK/VARIATION` renders one pair at any size for any seed. [Camera framing]"
                "(framing.md) measures the images and lists the rooms. [Add a task](adding-a-task.md) "
                "explains how to write a task of your own."
            ),
            "",
        ]
    )


def task_page(task: Task) -> str:
    """Return the page of one task."""
    summary, *notes = _docstring(task)
    described = [part for part in notes if not part.startswith(HEADINGS)]
    headed = {part.partition(":")[0]: part.partition(":")[2].strip() for part in notes if part.startswith(HEADINGS)}
    general = {"Success": f"{task.template.goal} {NO_HARM}", "Premise": task.template.premise}
    notes_by_heading = {
        heading: [text for text in (general.get(heading), _capitalized(headed.get(heading, ""))) if text]
        for heading in HEADINGS
    }
    lines = [
        f"# {task.title}",
        "",
        f"`{task.id}`, version {task.version}, template {_template_link(task.template, '../')}.",
        "",
        summary if summary == task.description else f"{task.description} {summary}",
        "",
        *[line for part in described for line in (part, "")],
        *[f"- **{h}:** {' '.join(texts)}" for h, texts in notes_by_heading.items() if texts],
        "",
        "## Training distribution",
        "",
        f"![the layouts of the training distribution](../pictures/{task.id}_training.jpg)",
        "",
        *_layout_table(task),
        "",
        *_condition_table(task),
        "",
        "Regularities that a policy can learn instead of the task, computed from the conditions above:",
        "",
        *[f"- {line}" for line in _confounds(task)],
        "",
        "## Variations",
        "",
        (
            "Each picture shows the training scene on the left and the test scene on the right. Both have seed 0 and "
            "are seen by the policy's front camera. The change made by the intervention is outlined."
        ),
        "",
        (
            "Names with `zoo:` and `probe:` are [faulty policies](../diagnosis.md#faulty-policies) and probes, which "
            "were run on the variations ([power matrix](../calibration.md#the-power-matrix)). The *shortcut ceiling* "
            "is the best success rate among the faulty policies that the variation can expose, the probes without "
            "instruction or images, and replayed demonstrations. *Construct validity* reports whether small learned "
            "policies solve the variation after training without the regularities listed above."
        ),
        "",
    ]
    for variation in task.variations:
        lines += _card(task, variation)
    return "\n".join(lines)


def settings_of(task: Task) -> dict[str, Condition]:
    """Return the distinct layouts of a training distribution: letter to the first condition with it."""
    found: dict[tuple[object, ...], Condition] = {}
    for condition in task.training:
        found.setdefault(_setting(condition), condition)
    return {chr(ord("A") + i): condition for i, condition in enumerate(found.values())}


def templates_page(tasks: Sequence[Task]) -> str:
    """Return the page of all templates."""
    lines = [
        "# Templates",
        "",
        (
            "A template is an interaction pattern. It consists of groups of objects, the relation that its subgoals "
            "require, and the step limits. A task adds the objects, their slots and the instructions. The template "
            "provides target regions, tolerances, settling time, step limit and expert."
        ),
        "",
        _row(["template", "main difficulty", "tasks"]),
        _row(["---"] * 3),
    ]
    own = {task.template.name: task.template for task in tasks if task.template.name not in TEMPLATES}
    for template in (*TEMPLATES.values(), *own.values()):
        users = ", ".join(f"[{t.title}](tasks/{t.id}.md)" for t in tasks if t.template is template)
        lines.append(_row([_template_link(template, "", page=""), template.challenge, users or "–"]))
    for template in (*TEMPLATES.values(), *own.values()):
        lines += ["", *_template_section(template)]
    shown = TEMPLATES["loose_packing"]
    lines += [
        "",
        "## The JSON form",
        "",
        (
            "Every template is also available as JSON, for tools that write scenarios. The allowed types are semantic "
            f"categories, not names of assets. This is the template {shown.title}:"
        ),
        "",
        "```json",
        json.dumps(template_to_json(shown), indent=2),
        "```",
        "",
        "```python",
        "from betterbench.tasks import TEMPLATES, template_from_json, template_to_json",
        "",
        'form = template_to_json(TEMPLATES["loose_packing"])',
        'assert template_from_json(form) == TEMPLATES["loose_packing"]',
        "```",
        "",
    ]
    return "\n".join(lines)


def _template_section(template: Template) -> list[str]:
    names = [template.relation, *template.also]
    total = template.base_steps + template.steps_per_subgoal
    only = f" {NO_HARM}" if template.exclusive else ""
    return [
        f"## {template.title}",
        "",
        f"`{template.name}`. {template.description} The main difficulty is {_lower_first(template.challenge)}",
        "",
        _row(["group", "meaning", "allowed types", "count"]),
        _row(["---"] * 4),
        *(
            _row([f"`{g.group_id}`", g.description, ", ".join(g.allowed_types), _span(g.count_range)])
            for g in template.groups
        ),
        "",
        *(f"- relation `{name}`: {_definition(name)}" for name in names),
        f"- success: every subgoal is met, with its objects at rest and released, for {template.dwell_s:g} s.{only}",
        (
            f"- step limit: {template.base_steps} control steps plus {template.steps_per_subgoal} for each subgoal "
            f"({total} steps or {total / 20:g} s for one subgoal). If the policy should stay still, the limit is "
            f"{template.still_steps} steps."
        ),
    ]


def _lower_first(text: str) -> str:
    return text[:1].lower() + text[1:]


def _definition(name: str) -> str:
    """Return the definition of a relation: the second paragraph of its predicate's docstring, or its wording."""
    relation = RELATIONS[name]
    module = importlib.import_module(f"betterbench.tasks.relations.{relation.name}")
    paragraphs = (inspect.getdoc(getattr(module, name)) or "").split("\n\n")
    words = relation.words.format(object="The object", target="the target", region="its region")
    defining = next((p for p in paragraphs[1:] if not p.startswith(("Args", "Returns", "Raises"))), f"{words}.")
    return " ".join(defining.replace(":data:", "").split())


def _docstring(task: Task) -> list[str]:
    """Return the paragraphs of a task's docstring; an indented continuation belongs to its heading."""
    paragraphs: list[str] = []
    for line in notes_of(task.id).splitlines():
        if not line.strip():
            paragraphs.append("")
        elif line.startswith(HEADINGS) or not paragraphs:
            paragraphs.append(line.strip())
        else:
            paragraphs[-1] = f"{paragraphs[-1]} {line.strip()}".strip()
    return [p for p in paragraphs if p]


def _setting(condition: Condition) -> tuple[object, ...]:
    return (
        tuple(sorted((condition.object(n).kind, s) for n, s in condition.layout.items())),
        tuple(sorted((condition.object(n).kind, p.target, p.region) for n, p in condition.preplaced.items())),
        tuple(sorted(condition.opened.items())),
    )


def _layout_table(task: Task) -> list[str]:
    settings = settings_of(task)
    lines = [
        _row(["slot or target", "x, y [m]", *(f"layout {letter}" for letter in settings)]),
        _row(["---"] * (2 + len(settings))),
    ]
    for slot in task.slots:
        standing = [c.object(name).kind if (name := c.occupant(slot.name)) else "–" for c in settings.values()]
        lines.append(_row([f"`{slot.name}`", f"{slot.x:g}, {slot.y:g}", *standing]))
    places = {p for c in settings.values() for p in c.preplaced.values()}
    for place in sorted(places, key=lambda p: (p.target, p.region)):
        resting = [
            ", ".join(c.object(n).kind for n, p in c.preplaced.items() if p == place) or "–" for c in settings.values()
        ]
        lines.append(_row([_place(place), "", *resting]))
    for drawer in sorted({name for c in settings.values() for name in c.opened}):
        states = [f"open by {c.opened[drawer]:g} m" if drawer in c.opened else "closed" for c in settings.values()]
        lines.append(_row([next(iter(settings.values())).object(drawer).kind, "", *states]))
    return lines


def _condition_table(task: Task) -> list[str]:
    letters = {_setting(c): letter for letter, c in settings_of(task).items()}
    return [
        _row(["condition", "layout", "instruction"]),
        _row(["---"] * 3),
        *(_row([f"`{c.name}`", letters[_setting(c)], f"“{c.instruction.text}”"]) for c in task.training),
    ]


def _confounds(task: Task) -> list[str]:
    trained = training_distribution_of(task)
    lines = []
    for word, slots in trained.word_slots.items():
        if slots:
            where = " or ".join(filter(None, (", ".join(f"`{s}`" for s in slots[:-1]), f"`{slots[-1]}`")))
            always = "always" if len(slots) == 1 else "only"
            lines.append(f"Objects that instructions call “{word}” are {always} picked at {where}.")
    total = len(task.training)
    if len(trained.first_kinds) == 1:
        lines.append(f"Every demonstration begins with the {trained.first_kinds[0][0]}.")
    else:
        counts = ", ".join(f"the {kind} in {n} of {total}" for kind, n in trained.first_kinds)
        lines.append(f"Demonstrations begin with {counts} conditions.")
    orders = sorted({", then ".join(kinds) for kinds in trained.sequences})
    lines.append(f"Objects are handled only in these orders: {'; '.join(orders)}.")
    for kind, places in sorted(_goes_to(task).items()):
        if len(places) == 1:
            lines.append(f"The {kind} is always placed at the same target: {places[0]}.")
    lone = [f"{kinds[0]} at `{slot}`" for slot, kinds in trained.standing_kinds.items() if len(kinds) == 1]
    if lone:
        lines.append(f"Slots with only one kind of object: {', '.join(lone)}.")
    lines.append(f"At most {trained.initial_items} movable objects are on the table at the start.")
    return lines


def _goes_to(task: Task) -> dict[str, list[str]]:
    """Return where each object kind was placed in training; empty if there is only one place."""
    found: dict[str, set[str]] = {}
    for condition in task.training:
        for goal in condition.instruction.subgoals:
            names = [n for n in condition.resolve(goal.reference) if condition.object(n).role != "drawer"]
            for kind in {condition.object(n).kind for n in names}:
                found.setdefault(kind, set()).add(_place(TargetRegion(goal.target, goal.region)))
    several = len({place for places in found.values() for place in places}) > 1
    return {kind: sorted(places) for kind, places in found.items()} if several else {}


def _card(task: Task, variation: Variation) -> list[str]:
    base = task.train(variation.base)
    test, changes = vary(task, variation)
    before, after = base.instruction.text, test.instruction.text
    told = f"“{before}”, as in training" if before == after else f"“{after}” instead of “{before}”"
    support = (
        "every slot, target and grasp occurs in training"
        if variation.support is Support.SEEN
        else "novel, because some slots do not occur in training"
    )
    look = ["- initial state: looks like the middle of a demonstration"] if variation.mid_task_look else []
    broken = (
        ["- premise: deliberately broken, because an object that the instruction names is absent"]
        if variation.premise_broken
        else []
    )
    steps = f"{variation.watch_steps} control steps"
    watched = [f"- after the goal is met: the trial continues for {steps}, in which a grasp attempt is a failure"]
    watched *= steps[0] != "0"
    return [
        f"### {variation.name}: {variation.title}",
        "",
        f"![{variation.base} beside {variation.name}](../pictures/{task.id}_{variation.name}.jpg)",
        "",
        f"- axis: {variation.axis.value.replace('_', ' ')}",
        f"- hypothesis: {variation.hypothesis}",
        f"- intervention on `{variation.base}`: {', '.join(f'`{_call(i)}`' for i in variation.interventions)}",
        *([] if changes.objects else ["- the scene is the same as in training; only the instruction changes"]),
        f"- instruction: {told}",
        f"- expected behavior: {variation.expected.value.replace('_', ' ')}",
        f"- support: {support}",
        *watched,
        *look,
        *broken,
        f"- can expose: {_exposed(task, variation)}",
        *_power((task.id, variation.name)),
        *_not_shown((task.id, variation.name)),
        f"- construct validity: {validity_text(task.id, variation.name)}",
        "",
    ]


def _exposed(task: Task, variation: Variation) -> str:
    """Return the labels that a variation can expose, or "no label"."""
    labels = exposed_labels(task.id, variation.name)
    return ", ".join(f"`{label}`" for label in labels) or "no label"


def _power(key: Key) -> list[str]:
    """Return the lines from the packaged power matrix: rules that fail the variation, and the shortcut ceiling."""
    matrix = power_matrix_of([key[0]])
    if matrix is None or key[0] in matrix.stale_tasks():
        return ["- faulty policies: not measured for this version (run `better calibrate --power`)"]
    if (ceiling := matrix.ceiling(key)) is None:
        return ["- faulty policies: not run on this variation, because no outcome of it counts as success or failure"]
    failing = ", ".join(f"`{name}`" for name in matrix.failing(key)) or "none"
    rate = f"{percent(ceiling.rate.k, ceiling.rate.n)} % ({ceiling.rate.k}/{ceiling.rate.n})"
    control = "control variation: only `zoo:halt` fails, because it stops at every new combination"
    passing = ", ".join(f"`{name}`" for name in matrix.passing_wrongly(key))
    guessed = ceiling.rate.k == ceiling.rate.n and matrix.chances.get(key, 0.0) >= 1.0
    return [
        *([f"- {control}"] if matrix.control(key) else []),
        f"- faulty policies that fail: {failing}",
        *([f"- faulty policies that succeed with a needless step: {passing}"] if passing else []),
        f"- shortcut ceiling: {rate}, by `{ceiling.pretender}`",
        *(["- language is not tested: only one instruction makes sense in this scene"] if guessed else []),
    ]


def _not_shown(key: Key) -> list[str]:
    """Return the line with the limits of a pass; empty if they are not measured."""
    matrix = power_matrix_of([key[0]])
    if matrix is None or key[0] in matrix.stale_tasks() or matrix.ceiling(key) is None:
        return []
    return [f"- limits: {not_shown(matrix, key)}"]


def _call(operation: Operation) -> str:
    """Return an operation as written in a task file, with names instead of constants."""
    values = [getattr(v, "text", getattr(v, "name", v)) for v in operation.arguments.values()]
    shown = [f'"{value}"' if " " in str(value) else str(value) for value in values]
    return f"{operation.name}({', '.join(shown)})"


def _capitalized(text: str) -> str:
    """Return text with its first letter in upper case."""
    return text[:1].upper() + text[1:]


def _template_link(template: Template, up: str, *, page: str = "templates.md") -> str:
    return f"[{template.title}]({up if page else ''}{page}#{template.title.lower().replace(' ', '-')})"


def _place(place: TargetRegion) -> str:
    return f"`{place.target}`" + (f", `{place.region}`" if place.region else "")


def _span(count: tuple[int, int]) -> str:
    low, high = count
    return str(low) if low == high else f"{low} to {high}"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
