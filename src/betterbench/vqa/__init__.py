"""Questions about images, with answers from records, and comparison of a model's knowledge with a policy's actions.

- ``types``: one file per type of question. ``phrasings`` and ``nouns`` contain the wording, and ``difficulty`` the
  levels of difficulty.
- ``dataset``, ``decisive``, ``freeform``, ``named_object``: sets of questions about records. ``balance`` balances their
  answers.
- ``asking``, ``scoring``, ``blind``, ``llm``: the answers of a model, their scores, and baselines without access to the
  image.
- ``knowing``: whether a model knew the right decision in the trials where the policy failed.
"""

from betterbench.vqa.asking import Answers, Score, ask_set, read_answers, scores_of
from betterbench.vqa.dataset import PhotoSource, QuestionSet, SetOptions, make_set, read_set
from betterbench.vqa.decisive import DecisiveOptions, make_decisive_set
from betterbench.vqa.knowing import Knowledge, KnowledgeStanding, knowledge_of
from betterbench.vqa.question import Difficulty, Form, Question, QuestionType

__all__ = [
    "Answers",
    "DecisiveOptions",
    "Difficulty",
    "Form",
    "Knowledge",
    "KnowledgeStanding",
    "PhotoSource",
    "Question",
    "QuestionSet",
    "QuestionType",
    "Score",
    "SetOptions",
    "ask_set",
    "knowledge_of",
    "make_decisive_set",
    "make_set",
    "read_answers",
    "read_set",
    "scores_of",
]
