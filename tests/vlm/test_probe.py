"""The probe names the convention of scripted models that look at the pictures, and refuses to guess."""

from __future__ import annotations

import functools
import io
import json

import numpy as np
import pytest
from PIL import Image
from tests.vlm import published
from tests.vlm.published import pictures_of, texts_of

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError
from betterbench.vlm import find_benchmark
from betterbench.vlm.models.eyes import Eyes
from betterbench.vlm.probe import TARGETS, Target, finding_of, probe_model, request_for

NOISE = 0.03


@functools.cache
def shape_in(picture):
    """Return the size of a picture, and the edges of the colored shape (left, top, right, bottom) as fractions."""
    with Image.open(io.BytesIO(picture)) as image:
        pixels = np.asarray(image.convert("RGB"))
    red, green, blue = np.moveaxis(pixels, 2, 0)
    brightest, darkest = (pick(pick(red, green), blue) for pick in (np.maximum, np.minimum))
    rows, columns = np.nonzero(brightest - darkest > 60)
    height, width = pixels.shape[:2]
    edges = [columns.min() / width, rows.min() / height, columns.max() / width, rows.max() / height]
    return (width, height), np.array(edges)


class Pointer:
    """A model that finds the colored shape in the picture and writes its place in a convention.

    Attributes:
        write: Writes the edges (left, top, right, bottom) as fractions of a picture with a width and height.
        noise: Standard deviation of each number, as a fraction of the side.
    """

    def __init__(self, write, *, noise=NOISE, seed=0, name="pointer"):
        self.name, self.write, self.noise, self.rng, self.asked = name, write, noise, np.random.default_rng(seed), 0

    def answer(self, prompt, pictures):
        self.asked += 1
        (width, height), place = shape_in(pictures[0])
        edges = place + self.rng.normal(0, self.noise, 4)
        middle = (edges[:2] + edges[2:]) / 2
        return self.write(edges if "bounding box" in prompt else middle, width, height)


def numbers(places, scale_x, scale_y, *, order="xy", digits=0):
    values = [p * (scale_x, scale_y)[i % 2] for i, p in enumerate(places)]
    if order == "yx":
        values = [values[i ^ 1] for i in range(len(values))]
    return [f"{v:.{digits}f}" for v in values]


def joined(*args, **options):
    return ", ".join(numbers(*args, **options))


def box_key(places, point, box):
    return point if len(places) == 2 else box


MODELS = {
    "RoboPoint: fractions in tuples": (lambda p, _w, _h: f"[({joined(p, 1, 1, digits=3)})]", "fractions"),
    "RoboBrain: pixels in tuples": (lambda p, w, h: f"({joined(p, w, h)})", "pixels"),
    "Qwen2.5-VL: pixels of a picture resized to multiples of 28": (
        lambda p, w, h: f"({joined(p, 28 * round(w / 28), 28 * round(h / 28))})", "pixels",
    ),
    "Qwen3-VL: thousandths in JSON": (
        lambda p, _w, _h: f'[{{"{box_key(p, "point_2d", "bbox_2d")}": [{joined(p, 1000, 1000)}], "label": "shape"}}]',
        "thousandths-json",
    ),
    "InternVL: thousandths in lists": (lambda p, _w, _h: f"[[{joined(p, 1000, 1000)}]]", "thousandths"),
    "Gemini: row before column, in fenced JSON": (
        lambda p, _w, _h: '```json\n[{"%s": [%s], "label": "a"}]\n```'  # noqa: UP031 - braces
        % (box_key(p, "point", "box_2d"), joined(p, 1000, 1000, order="yx")),
        "thousandths-yx-json",
    ),
    "Molmo: percent in XML, points only": (
        lambda p, _w, _h: '<point x="{}" y="{}" alt="shape">shape</point>'.format(
            *numbers((p[:2] + p[-2:]) / 2 if len(p) == 4 else p, 100, 100, digits=1)
        ),
        "percent-xml",
    ),
    "fractions in prose": (
        lambda p, _w, _h: f"The shape is located at ({joined(p, 1, 1, digits=2)}) in the image.", "fractions",
    ),
    "pixels after thinking": (
        lambda p, w, h: f"<think>Perhaps [1, 2]? It is {w} wide.</think>Answer: [{joined(p, w, h)}]", "pixels",
    ),
    "thousandths without brackets": (lambda p, _w, _h: joined(p, 1000, 1000), "thousandths"),
    "thousandths in JSON with prose": (
        lambda p, _w, _h: f'Here it is:\n```json\n[{{"point_2d": [{joined(p, 1000, 1000)}]}}]\n```', "thousandths-json",
    ),
    "row before column in lists": (lambda p, _w, _h: f"[{joined(p, 1000, 1000, order='yx')}]", "thousandths-yx-json"),
}  # fmt: skip


@functools.cache
def asked_for(target, eyes):
    """Return the prompt and the pictures about a target, which are the same for every model."""
    request = request_for(target, eyes=eyes)
    return request.prompt, request.pictures()


def probed(model, targets=TARGETS, *, eyes=Eyes.NATIVE):
    """The finding about a model, without a file of answers."""
    texts = []
    for target in targets:
        texts.append(model.answer(*asked_for(target, eyes)))
    return finding_of(model.name, texts, targets, eyes=eyes)


def test_the_convention_of_each_model_is_named():
    for name, (write, true) in MODELS.items():
        for seed in range(3):
            finding = probed(Pointer(write, seed=seed))
            assert finding.found == true, (name, seed, finding.sentence)


@pytest.mark.parametrize("eyes", [Eyes.TILE_1, Eyes.BLUR_224, Eyes.NATIVE_224])
def test_pixels_are_those_of_the_shown_picture(eyes):
    model = Pointer(MODELS["RoboBrain: pixels in tuples"][0])
    assert probed(model, eyes=eyes).found == "pixels"


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda p, _w, _h: f"[{joined(p, 1, 1, order='yx', digits=3)}]", "fractions, row before column"),
        (lambda p, w, h: f"[{joined(p, w, h, order='yx')}]", "pixels, row before column"),
    ],
)
def test_an_order_and_scale_without_a_convention_is_described(write, words):
    finding = probed(Pointer(write))
    assert finding.found is None
    assert words in finding.sentence
    assert "no convention" in finding.sentence
    with pytest.raises(InvalidInputError, match=r"pixels are declared, but .*no convention.*--no-probe"):
        finding.require("pixels")


def test_where_two_fit_none_is_named():
    """In pictures of 1000 pixels a side, pixels are thousandths."""
    square = [Target(t.shape, t.color, (1000, 1000), t.middle, t.half) for t in TARGETS]
    model = Pointer(MODELS["RoboBrain: pixels in tuples"][0])
    finding = probed(model, square)
    assert finding.found is None
    assert {fit.scale for fit in finding.fitting} == {"pixels", "thousandths"}
    assert "several conventions" in finding.sentence
    # The diagonal does not tell the order.
    diagonal = [Target("disk", t.color, t.size, (t.middle[0], t.middle[0])) for t in TARGETS]
    model = Pointer(MODELS["RoboPoint: fractions in tuples"][0])
    finding = probed(model, diagonal)
    assert {fit.order for fit in finding.fitting} == {"xy", "yx"}
    assert finding.found is None


@pytest.mark.parametrize(
    "write",
    [
        lambda _p, _w, _h: "[(0.5, 0.5)]",
        lambda _p, _w, _h: "[500, 500]",
        lambda _p, w, h: f"({w // 2}, {h // 2})",
        lambda p, _w, _h: f"({joined(1 - p, 1, 1, digits=3)})",
    ],
)
def test_a_model_that_does_not_point_at_the_shape_has_no_convention(write):
    finding = probed(Pointer(write))
    assert finding.found is None
    assert "does not point" in finding.sentence


def test_a_model_that_guesses_places_has_no_convention():
    rng = np.random.default_rng(3)
    for _ in range(20):
        model = Pointer(lambda _p, _w, _h: f"[({rng.random():.3f}, {rng.random():.3f})]")
        assert probed(model).found is None


@pytest.mark.parametrize("text", ["", "I cannot see the image.", "The disk is red.", "{", "[1, 2, 3]", "1e999, 2"])
def test_answers_without_coordinates_tell_nothing(text):
    finding = finding_of("m", [text] * len(TARGETS))
    assert (finding.found, finding.readable) == (None, 0)
    assert "gave coordinates for 0 of 10" in finding.sentence


def test_a_wrong_declaration_is_named_with_the_right_one(tmp_path):
    gemini = Pointer(MODELS["Gemini: row before column, in fenced JSON"][0])
    finding = probe_model(gemini, tmp_path / "probe.jsonl", declared="thousandths-json", at_once=1)
    with pytest.raises(InvalidInputError, match=r"row before column.*--coordinates thousandths-yx-json"):
        finding.require("thousandths-json")
    finding.require("thousandths-yx-json")


def test_another_written_form_of_the_same_numbers_is_no_wrong_declaration(tmp_path):
    model = Pointer(MODELS["InternVL: thousandths in lists"][0])
    probe_model(model, tmp_path / "probe.jsonl", declared="thousandths-json", at_once=1).require("thousandths-json")


def test_a_repeated_probe_asks_nothing(tmp_path):
    model = Pointer(MODELS["InternVL: thousandths in lists"][0])
    first = probe_model(model, tmp_path / "probe.jsonl", at_once=1)
    assert probe_model(model, tmp_path / "probe.jsonl", at_once=1) == first
    assert model.asked == len(TARGETS) == 10


class Endpoint:
    """A chat server that points at the shapes of a probe, and answers everything else with the middle."""

    def __init__(self, write):
        self.pointer = Pointer(write, noise=0.0)

    def __call__(self, body):
        return self.pointer.answer(texts_of(body), pictures_of(body))


def lines(folder, url, *more):
    return ["vlm", "refspatial", "--data", str(folder), "--model", f"{url}#tiny", *more]


def test_a_run_stops_before_its_first_question_if_the_declaration_is_wrong(tmp_path, serve, capsys):
    folder = published.refspatial_raw(tmp_path / "data")
    server = serve(Endpoint(MODELS["InternVL: thousandths in lists"][0]))
    out = tmp_path / "run"
    assert main(lines(folder, server.url, "--out", str(out))) != 0
    assert "--coordinates thousandths" in " ".join(capsys.readouterr().err.split())
    assert len(server.asked) == 10
    assert not (out / "answers.jsonl").exists()


def test_a_right_declaration_costs_ten_requests_once(tmp_path, serve):
    folder, out = published.refspatial_raw(tmp_path / "data"), tmp_path / "run"
    server = serve(Endpoint(MODELS["InternVL: thousandths in lists"][0]))
    line = lines(folder, server.url, "--out", str(out), "--coordinates", "thousandths")
    items = len(find_benchmark("refspatial").load(folder).items)
    for _ in range(2):
        assert main(line) == 0
        assert len(server.asked) == 10 + items
    assert "thousandths of the width" in texts_of(server.asked[0])


def test_vlm_probe_prints_the_convention(serve, capsys):
    server = serve(Endpoint(MODELS["Gemini: row before column, in fenced JSON"][0]))
    assert main(["vlm", "probe", "--model", f"{server.url}#tiny"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert (
        "tiny answers in thousandths, row before column (--coordinates thousandths-yx-json) for 10 of 10 images" in out
    )
    assert main(["vlm", "probe", "--model", f"{server.url}#tiny", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["found"] == "thousandths-yx-json"


def test_eyes_reach_the_endpoint_and_the_prompt(tmp_path, serve):
    folder, out = published.refspatial_raw(tmp_path / "data"), tmp_path / "run"
    server = serve(Endpoint(MODELS["RoboBrain: pixels in tuples"][0]))
    line = lines(folder, server.url, "--out", str(out), "--coordinates", "pixels", "--eyes", "blur-224")
    assert main(line) == 0
    for body in server.asked:
        with Image.open(io.BytesIO(pictures_of(body)[0])) as image:
            assert image.size == (448, 448)
        assert "448 pixels wide and 448 high" in texts_of(body)
    assert json.loads((out / "run.json").read_text())["eyes"] == "blur-224"
    with Image.open(out / "shown.png") as sheet:
        assert sheet.width > 4 * 448


def test_pixels_of_the_shown_picture_score_in_the_original_one(tmp_path, serve):
    """The right place, in pixels of the square, is right in every resolution."""
    folder = published.refspatial_raw(tmp_path / "data")
    scores = {}
    for eyes, (x, y) in {"native": (40, 18), "tile-1": (280, 168), "native-224": (140, 84)}.items():
        server = serve(lambda _, x=x, y=y: f"[({x}, {y})]")
        out = tmp_path / eyes
        line = lines(folder, server.url, "--out", str(out), "--coordinates", "pixels", "--eyes", eyes, "--no-probe")
        assert main(line) == 0
        scores[eyes] = json.loads((out / "result.json").read_text())["headline"]["parsed"]
    assert scores == dict.fromkeys(scores, 1.0)


def test_tiles_reach_the_endpoint(tmp_path, serve):
    folder = published.refspatial_raw(tmp_path / "data")
    server = serve(lambda _: "[(0.5, 0.5)]")
    assert main(lines(folder, server.url, "--out", str(tmp_path / "run"), "--no-probe", "--max-tiles", "6")) == 0
    assert {str(body["mm_processor_kwargs"]) for body in server.asked} == {"{'max_dynamic_patch': 6}"}


def test_tiles_of_a_single_tile_are_refused(tmp_path, capsys):
    line = lines(tmp_path, "http://127.0.0.1:9", "--out", str(tmp_path / "run"), "--eyes", "tile-1", "--max-tiles", "6")
    assert main(line) != 0
    assert "uses one tile per image" in " ".join(capsys.readouterr().err.split())
