"""Hostile answers of a server, from the request to the stored score, as the documentation says."""

from __future__ import annotations

import json
import re
from fractions import Fraction

import pytest
from tests.vlm import published
from tests.vlm.published import texts_of

from betterbench.cli.main import main

B_STRICT, B_TOLERANT, NOTHING = ("B", "strict"), ("B", "tolerant"), (None, "none")

LETTERS = [
    ("", NOTHING),
    (None, NOTHING),
    (" \n\t ", NOTHING),
    ("I'm sorry, but I can't help with that.", NOTHING),
    ("As an AI model, I cannot determine this from the image.", NOTHING),
    ("None of the options.", NOTHING),
    ("<|im_end|>", NOTHING),
    ("100%", NOTHING),
    ("E", NOTHING),
    ("ABCD", NOTHING),
    ("A or B", NOTHING),
    ("A, B, C and D are all possible", NOTHING),
    ("B. mug", NOTHING),  # the letter of one option with the words of another
    ("The answer is not B", NOTHING),
    ("<think>It could be B, but", NOTHING),
    ("<think>B</think>", NOTHING),
    ("B", B_STRICT),
    ("(B)", B_STRICT),
    ("B. lamp", B_STRICT),
    ("Lamp.", B_STRICT),
    ("Ｂ", B_STRICT),
    ("<think>A looks near. Maybe C?</think>B", B_STRICT),
    ("A? No. </think> B", B_STRICT),
    ("b", B_TOLERANT),
    ("**B**", B_TOLERANT),
    ("\\boxed{B}", B_TOLERANT),
    ("<answer>B</answer>", B_TOLERANT),
    ('{"answer": "B"}', B_TOLERANT),
    ('{"answer": "B"', B_TOLERANT),
    ('```json\n{"answer": "B"}\n```', B_TOLERANT),
    ("The answer is B.", B_TOLERANT),
    ("Answer: D. Wait, no. Final answer: B", B_TOLERANT),
    ("It is not A. It is B.", B_TOLERANT),
    ("A person stands near the lamp.", B_TOLERANT),
    ("Die Antwort ist B.", B_TOLERANT),
    ("La respuesta es B", B_TOLERANT),
    ("Ответ: B", B_TOLERANT),
    ("答案是B", B_TOLERANT),
    ("x" * 1_000_000 + " The answer is B.", B_TOLERANT),
    ("The answer is B. " + "y" * 1_000_000, NOTHING),  # only the end is read
]
"""Texts about a choice with the correct answer B, and their value and stage."""

POINTS = [
    ("[(0.625, 0.375)]", "strict", 1),
    ("[( .625 , .375 )]", "strict", 1),
    ("[[0.625, 0.375]]", "strict", 1),
    ("[(0.625, 0.375), (0.9, 0.9)]", "strict", Fraction(1, 2)),
    ("[(0.5, 0.25, 0.75, 0.5)]", "strict", 1),  # a box: all its pixels
    ("[(0.375, 0.625)]", "strict", 0),  # row before column
    ("[(625, 375)]", "strict", 0),  # thousandths
    ("[(40, 18)]", "strict", 0),  # pixels
    ("[(62.5, 37.5)]", "strict", 0),  # percent
    ("[(-0.1, 0.375)]", "strict", 0),
    ("[(1.0, 1.0)]", "strict", 0),
    ('[{"point_2d": [0.625, 0.375]}]', "tolerant", 1),
    ('[{"point_2d": [0.625, 0.375]', "tolerant", 1),
    ('<point x="0.625" y="0.375">mug</point>', "tolerant", 1),
    ("The point is (0.625, 0.375).", "tolerant", 1),
    ("[(0.625, 0.375", "tolerant", 1),
    ("[(nan, 0.375)]", "none", 0),
    ("There is no mug in the image.", "none", 0),
    ("[]", "none", 0),
]
"""Texts about a point in the target region around (0.625, 0.375), in fractions, and their stage and score."""


def scored(name, folder, answers, serve, tmp_path):
    """Returns the stored items of a run whose n-th question gets the n-th answer, and the result."""

    def answer(body):
        return answers[int(re.search(r"number (\d+)", texts_of(body))[1])]

    out = tmp_path / "run"
    line = ["vlm", name, "--data", str(folder), "--model", f"{serve(answer).url}#m", "--out", str(out), "--no-probe"]
    assert main([*line, "--scoring", "official"]) == 0
    lines = (out / "items.jsonl").read_text().splitlines()[:-1]  # the last line is the seal
    return [json.loads(text) for text in lines], json.loads((out / "result.json").read_text())


def test_at_least_forty_hostile_answers():
    assert len(LETTERS) >= 40


def test_hostile_answers_to_a_choice(serve, tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    picture = published.base64.b64encode(published.picture(1)).decode()
    rows = [
        row | {"question": f"Which one? Question number {i}.", "answer": 1, "image": picture}
        for i, row in enumerate(published.embspatial_rows(len(LETTERS)))
    ]
    (folder / "questions.json").write_text(json.dumps(rows))
    items, result = scored("embspatial", folder, [text for text, _ in LETTERS], serve, tmp_path)
    wrong = [
        (str(text)[:60], expected, (item["value"], item["stage"]))
        for (text, expected), item in zip(LETTERS, items, strict=True)
        if (item["value"], item["stage"]) != expected
    ]
    assert not wrong
    assert [item["score"] for item in items] == [str(int(value == "B")) for _, (value, _) in LETTERS]
    stages = [stage for _, (_, stage) in LETTERS]
    everything = result["parts"][0]
    assert (everything["n"], everything["read"]) == (len(LETTERS), len(LETTERS) - stages.count("none"))
    assert everything["answered"] == len(LETTERS) - 2  # an empty text and null are no answers
    assert result["headline"]["strict"] == pytest.approx(stages.count("strict") / len(LETTERS))
    assert result["headline"]["parsed"] == pytest.approx(1 - stages.count("none") / len(LETTERS))


def test_hostile_answers_to_a_point(serve, tmp_path):
    folder = published.refspatial_raw(tmp_path / "data")
    for split in ("Location", "Placement", "Unseen"):
        file = folder / split / "question.json"
        (row, *_) = json.loads(file.read_text())
        count = len(POINTS) if split == "Location" else 1
        file.write_text(json.dumps([row | {"id": i, "prompt": f"Point at number {i}."} for i in range(count)]))
    items, result = scored("refspatial", folder, [text for text, *_ in POINTS], serve, tmp_path)
    found = [(item["stage"], Fraction(item["score"])) for item in items[: len(POINTS)]]
    wrong = [(p, f) for p, f in zip(POINTS, found, strict=True) if f != (p[1], p[2])]
    assert not wrong
    assert result["outside_the_picture"] == 4  # thousandths, pixels, percent and a negative number
    total = sum((Fraction(score) for _, _, score in POINTS), Fraction(0))
    assert result["parts"][0]["n"] == len(POINTS) + 2
    assert result["headline"]["parsed"] == pytest.approx(float((total / len(POINTS) + 1) / 2))
