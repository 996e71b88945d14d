"""What the process of a policy sends is read as it was sent, or refused in one line."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from betterbench.errors import PolicyError
from betterbench.policies.process.process_link import LENGTH, SIZES, ProcessAnswer, answer_frame, plain_array
from betterbench.policies.process.process_reader import read_answer


def sent(head: dict, data: bytes = b"") -> bytes:
    text = json.dumps(head).encode()
    return SIZES.pack(0, len(text))[LENGTH.size :] + text + data


def test_answers_are_read_as_they_were_sent():
    chunk = np.arange(14, dtype=np.float32).reshape(2, 7)
    form, data = plain_array(chunk)
    answer, arrays = read_answer(answer_frame(ProcessAnswer(3, (form, form)), [data, data])[LENGTH.size :])
    assert answer.number == 3
    assert len(arrays) == 2
    assert all(np.array_equal(array, chunk) and array.dtype == chunk.dtype for array in arrays)


@pytest.mark.parametrize(
    "head",
    [
        {"number": -1},
        {"number": True},
        {"number": 1, "more": 0},
        {"number": 1, "arrays": [["<f8", [-1]]]},
        {"number": 1, "arrays": [["<f8", [1 << 40]]]},
        {"number": 1, "arrays": [["<f8", [1] * 33]]},
        {"number": 1, "arrays": [["f" * 41, [1]]]},
        {"number": 1, "arrays": [["<f8", [2]]]},
        {"number": 1, "declared": {"name": "mine"}},
    ],
)
def test_what_is_no_answer_is_refused(head):
    with pytest.raises(PolicyError):
        read_answer(sent(head, bytes(8)))


def test_the_process_of_a_policy_imports_what_it_needs_and_no_more():
    code = "import sys, betterbench.policies.process.asked_process; print('\\n'.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert not {"mujoco", "scipy", "pydantic", "importlib.metadata", "gymnasium"} & set(run.stdout.split())
