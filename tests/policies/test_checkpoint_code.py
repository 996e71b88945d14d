"""Code that a checkpoint of LeRobot names is refused before LeRobot sees it."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from betterbench.errors import UNPRINTABLE, InvalidInputError
from betterbench.policies.clients import checkpoint
from betterbench.policies.clients.checkpoint_code import PROCESSORS, require_no_code

OWN = {"registry_name": "normalizer_processor", "config": {"eps": 1e-8}, "state_file": "x.safetensors"}
CONFIG = SimpleNamespace(action_tokenizer_name="physical-intelligence/fast", action_tokenizer_path=None)


def files(tmp_path, *steps, text=None):
    """Write the files of both processors, the second with the steps or the text."""
    found = {name: tmp_path / name for name in PROCESSORS}
    found[PROCESSORS[0]].write_text(json.dumps({"name": "p", "steps": [OWN]}))
    found[PROCESSORS[1]].write_text(json.dumps({"name": "p", "steps": [OWN, *steps]}) if text is None else text)
    return found


def test_steps_of_lerobot_pass(tmp_path):
    require_no_code(CONFIG, files(tmp_path, OWN), "policy p")
    require_no_code(object(), {}, "policy p")


@pytest.mark.parametrize(
    "step",
    [
        {"class": "os.system", "config": {"command": "touch x"}},
        {"class": "subprocess.Popen", "config": {"args": ["touch", "x"]}},
        {"class": "lerobot.utils.utils.say", "config": {"text": "x"}},
        {"class": "\x1b[2J\u202e.x\ud800" + "y" * 10_000},
        {"registry_name": ["normalizer_processor"], "class": "os.system"},
        {"registry_name": None},
        {},
    ],
)
def test_a_step_that_is_not_registered_is_refused(tmp_path, step):
    with pytest.raises(InvalidInputError, match=r"step 1 of policy_postprocessor.json names the class") as caught:
        require_no_code(CONFIG, files(tmp_path, step), "policy p")
    assert not UNPRINTABLE.search(str(caught.value))
    assert "\n" not in str(caught.value)
    assert "trust=true" in str(caught.value)
    assert len(str(caught.value)) < 500


def test_a_tokenizer_of_another_repository_is_refused(tmp_path):
    step = {"registry_name": "action_tokenizer_processor", "config": {"action_tokenizer_name": "evil/fast"}}
    with pytest.raises(
        InvalidInputError, match=r"action_tokenizer_name in step 1 .*'evil/fast' instead of 'physical-int"
    ):
        require_no_code(CONFIG, files(tmp_path, step), "policy p")
    for name in ("action_tokenizer_name", "action_tokenizer_path", "text_tokenizer_name", "tokenizer_assets_repo"):
        with pytest.raises(InvalidInputError, match=f"its {name} is './here'"):
            require_no_code(SimpleNamespace(**{name: "./here"}), files(tmp_path), "policy p")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "cannot be read"),
        ("[]", "does not contain a list of steps"),
        ('{"steps": {}}', "does not contain a list of steps"),
        ('{"steps": [1]}', "does not contain a list of steps"),
        ('{"steps": [], "steps": [{"class": "os.system"}]}', "is given twice"),
        ("[" * 100_000, "nested too deep"),
    ],
)
def test_a_malformed_file_is_one_line(tmp_path, text, problem):
    with pytest.raises(InvalidInputError, match=problem) as caught:
        require_no_code(CONFIG, files(tmp_path, text=text), "policy p")
    assert "\n" not in str(caught.value)


class NotThereError(Exception):
    """Of the hub: it has no such file."""


class NotHereError(NotThereError):
    """Of the hub: the file cannot be fetched, and is not on this machine."""


@pytest.mark.parametrize(("error", "known"), [(NotThereError, {}), (NotHereError, None)])
def test_a_file_on_the_hub_that_cannot_be_fetched_is_not_passed_over(monkeypatch, error, known):
    def download(repository, name):
        raise error(f"{repository}/{name}")

    modules = {
        "huggingface_hub": SimpleNamespace(hf_hub_download=download),
        "huggingface_hub.errors": SimpleNamespace(
            EntryNotFoundError=NotThereError, LocalEntryNotFoundError=NotHereError
        ),
    }
    monkeypatch.setattr(checkpoint, "_import", modules.__getitem__)
    if known is not None:
        assert checkpoint._processor_files("owner/name") == known
        return
    with pytest.raises(NotHereError):
        checkpoint._processor_files("owner/name")
