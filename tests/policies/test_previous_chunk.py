"""What is left of a chunk when the next one is asked for."""

import numpy as np
import pytest

from betterbench.policies.clients.being_h import continue_previous_chunk
from betterbench.policies.clients.previous_chunk import moved_up, rows_left


@pytest.mark.parametrize("shape", [(8, 2), (1, 8, 2)])
def test_the_first_row_is_that_of_the_step(shape):
    chunk = np.broadcast_to(np.arange(8.0)[:, None], shape).copy()
    assert [rows_left(10, chunk, step=step) for step in (9, 10, 13, 18, 40)] == [0, 8, 5, 0, 0]
    moved = moved_up(10, chunk, step=13)
    assert moved.shape == shape
    assert moved[..., 0].ravel().tolist() == [3, 4, 5, 6, 7, 7, 7, 7]


@pytest.mark.parametrize(("step", "delay", "continued"), [(13, 5, True), (13, 6, False), (13, 0, False), (9, 1, False)])
def test_being_h_is_sent_a_rest_that_is_long_enough(step, delay, continued):
    added = continue_previous_chunk(10, np.zeros((8, 2)), step=step, delay=delay)
    assert bool(added) is continued
    assert not continued or (added["inference_delay"], added["prev_chunk"].shape) == (delay, (8, 2))
