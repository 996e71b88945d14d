"""What the process of a policy sends is read as it was sent, or refused in one line."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from betterbench.errors import PolicyError
from betterbench.policies.process.process_link import ProcessAnswer, content_of
from betterbench.policies.process.process_reader import read_answer


def test_answers_are_read_as_they_were_given():
    chunk = np.arange(14, dtype=np.float32).reshape(2, 7)
    answer, arrays = read_answer(content_of(ProcessAnswer(), [chunk, chunk.tolist()]))
    assert answer == ProcessAnswer()
    assert [array.dtype for array in arrays] == [np.float32, np.float64]
    assert all(np.array_equal(array, chunk) for array in arrays)
    arrays[0][:] = 0.0
    assert chunk.any()


@pytest.mark.parametrize(
    "content",
    [
        ({"error": 1}, {}),
        ({"more": 0}, {}),
        ({"texts": "wicked"}, {}),
        ({"declared": {"name": "mine"}}, {}),
        ({}, {"1": np.zeros(7)}),
        ({}, {"0": np.zeros(7), "one": np.zeros(7)}),
    ],
)
def test_what_is_no_answer_is_refused(content):
    with pytest.raises(PolicyError):
        read_answer(content)


LOADS = """
import sys
from betterbench.policies.process.asked_process import find_kind, make_policy, read_address
make_policy(sys.argv[1])
assert find_kind(sys.argv[1]).source_of(read_address(sys.argv[1])).startswith("still.py, sha256 ")
print(*sys.modules, sep="\\n")
"""

STILL = """
from betterbench.interface import PolicyInfo
class Still:
    info = PolicyInfo("still")
    def reset(self, start):
        pass
    def act(self, seen):
        return [0.0] * 7
"""


def test_the_process_of_a_policy_imports_what_it_needs_and_no_more(tmp_path):
    (tmp_path / "still.py").write_text(STILL, encoding="utf-8")
    command = [sys.executable, "-c", LOADS, f"python:{tmp_path / 'still.py'}:Still"]
    run = subprocess.run(command, check=True, capture_output=True, text=True)
    assert not {"mujoco", "scipy", "pydantic", "importlib.metadata", "gymnasium"} & set(run.stdout.split())
