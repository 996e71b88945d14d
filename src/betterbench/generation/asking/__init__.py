"""Scenarios by a language model, with checks, corrections and kept exchanges.

- ``prompt``: the wording of all questions.
- ``exchanges``: the file of questions and answers, and its replay without the model.
- ``author``: the loop that asks, checks and sends problems back.
"""

from betterbench.generation.asking.author import (
    Asked,
    Refused,
    Request,
    ask_for_scenario,
    ask_for_scenarios,
    ask_for_template,
)
from betterbench.generation.asking.exchanges import ExchangeFile, KeptChat, read_exchanges

__all__ = [
    "Asked",
    "ExchangeFile",
    "KeptChat",
    "Refused",
    "Request",
    "ask_for_scenario",
    "ask_for_scenarios",
    "ask_for_template",
    "read_exchanges",
]
