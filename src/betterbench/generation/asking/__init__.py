"""Scenarios written by a language model, with checks, corrections and stored exchanges.

- ``prompt``: the wording of all requests.
- ``exchanges``: the file that stores all requests and answers, so that they can be replayed without the model.
- ``author``: the loop that requests scenarios, checks them, and sends problems back.
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
