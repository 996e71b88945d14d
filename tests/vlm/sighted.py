"""Our own sets without images of scenes, and scripted models whose eyesight is known."""

from __future__ import annotations

import hashlib
import io
import math
from functools import lru_cache

import numpy as np
from PIL import Image

from betterbench.vlm.benchmarks.better_vqa import items_of
from betterbench.vqa.dataset import QuestionSet
from betterbench.vqa.question import Difficulty, Form, FrameSource, Question, QuestionType

SIDE = 896
"""Side of the images [pixel]."""
DETAIL = {"native": 1.0, "tile-1": 448 / 896, "blur-224": 224 / 896, "native-224": 224 / 896}
"""Share of the detail of an image of 896 pixels that each of the eyes keeps, as stated in docs/vlm.md."""
FAMILIES = {
    "side in image": (QuestionType.RELATION, ("Yes", "No")),
    "closer to camera": (QuestionType.RELATION, ("the mug", "the can")),
    "side for robot": (QuestionType.RELATION, ("Yes", "No")),
    "outermost": (QuestionType.RELATION, ("the mug", "the can", "the pan")),
    "is it open": (QuestionType.STATE, ("Yes", "No")),
    "what is in": (QuestionType.CONTAINMENT, ("the mug", "the can", "the pan", "nothing")),
    "how many of kind": (QuestionType.COUNTING, ("0", "1", "2", "3")),
}


@lru_cache(maxsize=1)
def picture():
    file = io.BytesIO()
    Image.new("RGB", (SIDE, SIDE), "gray").save(file, "PNG")
    return file.getvalue()


def question(number, draw, folder):
    """Returns a question of each family in turn, about two objects of 24 to 320 pixels."""
    family = list(FAMILIES)[number % len(FAMILIES)]
    kind, answers = FAMILIES[family]
    answer = answers[int(draw.integers(len(answers)))]
    form = Form.YES_NO if "Yes" in answers else Form.NUMBER if "0" in answers else Form.CHOICE
    sizes = np.exp(draw.uniform(math.log(24), math.log(320), 2)).round().astype(int).tolist()
    boxes = tuple((100, 100, 100 + s, 100 + s) for s in sizes)
    return Question(
        id=f"q{number}", type=kind, form=form, family=family, text=f"Question {number}?",
        options=answers if form is Form.CHOICE else (), answer=answer, image=folder, width=SIDE, height=SIDE,
        difficulty=Difficulty.EASY, tags=(), objects=("a", "b"), group=(family,), words={}, chance=1 / len(answers),
        source=FrameSource("task", "training", number // 8, 0, 0.0, "front"), boxes=boxes,
    )  # fmt: skip


def questions(count=560, seed=0):
    draw = np.random.default_rng(seed)
    return tuple(question(i, draw, "image.png") for i in range(count))


def own_set(folder, count=560):
    """Writes the only image and returns the items of a set of ``count`` questions, eight per trial."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "image.png").write_bytes(picture())
    made = questions(count)
    digest = hashlib.sha256(str(made).encode()).hexdigest()
    return items_of(QuestionSet(folder, "test", made, (), digest))


class Sighted:
    """A model that knows an answer if all objects are larger than ``s`` pixels as it sees them, else guesses.

    Args:
        s: Smallest size that it reads.
        eyes: Its eyes.
        wrong: Share of wrong answers to what it reads.
        lost: Family whose questions it can only guess.
        guesses: Whether it guesses; otherwise it says that it cannot see.
    """

    def __init__(self, s, eyes, *, wrong=0.05, seed=0, lost="", guesses=True, name="scripted"):
        self.name = name
        self.asked = {q.text: q for q in questions()}
        self.s, self.eyes, self.wrong, self.seed, self.lost, self.guesses = s, eyes, wrong, seed, lost, guesses

    def answer(self, prompt, _pictures):
        return self.reply(self.asked[prompt.split("\n")[0]])

    def reply(self, asked):
        draw = np.random.default_rng([self.seed, int(asked.id[1:]), round(1000 * DETAIL[self.eyes])])
        answers = FAMILIES[asked.family][1]
        smallest = min(box[2] - box[0] for box in asked.boxes) * DETAIL[self.eyes]
        if smallest < self.s or asked.family == self.lost:
            if not self.guesses:
                return "I cannot see this."
            said = answers[int(draw.integers(len(answers)))]
        elif draw.random() < self.wrong:
            others = [a for a in answers if a != asked.answer]
            said = others[int(draw.integers(len(others)))]
        else:
            said = asked.answer
        return said
