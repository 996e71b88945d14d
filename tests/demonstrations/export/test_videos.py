"""Videos: exact times, the same bytes, joined without loss, and a bounded error."""

from __future__ import annotations

import io

import av
import numpy as np
import pytest

from betterbench.demonstrations.export.video import VideoWriter, join, read_pictures
from betterbench.errors import InvalidInputError

RATE = 20


def pictures(count: int, shift: int = 0) -> list[np.ndarray]:
    x, y = np.meshgrid(np.arange(64), np.arange(48))
    return [
        np.stack([x + shift // 2 + 3 * i, 2 * y + i, x + y + shift // 2], axis=2).astype(np.uint8) for i in range(count)
    ]


def encoded(shown: list[np.ndarray]) -> bytes:
    writer = VideoWriter(rate_hz=RATE)
    for picture in shown:
        writer.add(picture)
    return writer.finish()


def read(video: bytes) -> list[tuple[int, np.ndarray]]:
    return list(read_pictures(io.BytesIO(video)))


def test_pictures_come_back_in_number_time_and_within_the_error():
    shown = pictures(7)
    video = encoded(shown)
    assert video == encoded(shown)
    with av.open(io.BytesIO(video)) as container:
        times = [float(frame.pts * frame.time_base) for frame in container.decode(video=0)]
    assert times == pytest.approx([i / RATE for i in range(7)], abs=1e-6)
    found = read(video)
    assert [number for number, _ in found] == list(range(7))
    for (_, picture), wanted in zip(found, shown, strict=True):
        assert np.abs(picture.astype(int) - wanted.astype(int)).mean() < 2.0


def test_joined_videos_are_their_pictures_one_after_the_other_bit_for_bit():
    parts = [encoded(pictures(count, shift)) for count, shift in ((5, 0), (1, 90), (4, 160))]
    joined = join(parts, rate_hz=RATE)
    assert joined == join(parts, rate_hz=RATE)
    found = read(joined)
    assert [number for number, _ in found] == list(range(10))
    wanted = [picture for part in parts for _, picture in read(part)]
    for (_, picture), alone in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(picture, alone)


@pytest.mark.parametrize("first", [0, 1, 4, 7, 9])
def test_a_video_is_read_from_any_picture_on(first):
    joined = join([encoded(pictures(6)), encoded(pictures(4, 50))], rate_hz=RATE)
    number, picture = next(read_pictures(io.BytesIO(joined), first=first))
    assert number == first
    np.testing.assert_array_equal(picture, read(joined)[first][1])


def test_odd_sizes_and_empty_videos_are_refused():
    with pytest.raises(InvalidInputError, match="63 x 48 pixels"):
        encoded([np.zeros((48, 63, 3), np.uint8)])
    with pytest.raises(InvalidInputError, match="no images"):
        encoded([])


def test_what_is_no_video_is_one_line(tmp_path):
    path = tmp_path / "a.mp4"
    path.write_bytes(b"nothing of the kind" * 20)
    with pytest.raises(InvalidInputError, match=r"a\.mp4: the video cannot be read") as caught:
        list(read_pictures(str(path)))
    assert "\n" not in str(caught.value)
