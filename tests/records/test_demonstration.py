"""What demonstrations add to records, and that it leaves other records as they are."""

from __future__ import annotations

from dataclasses import replace

import pytest

from betterbench.errors import InvalidInputError
from betterbench.records import Demonstrator, SkillWindow, SubgoalSegment, read_record, record_bytes, write_record

PICK = SkillWindow("pick", "thing_0", "", "", "", 0, 1, 2)


def test_a_demonstration_survives_the_disk(make_record, tmp_path):
    record, _ = make_record(rows=5)
    demonstrator = Demonstrator("amplified", "amplify", {"speed": 0.5}, ("fast_food/train1/1000000",), 0.02)
    segments = (
        SubgoalSegment("pack", "thing_0", "thing_1", "inside", "", 0, 3, (PICK,)),
        SubgoalSegment("", "", "", "", "", 3, 5),
    )
    changed = replace(record, metadata=replace(record.metadata, demonstrator=demonstrator, segments=segments))
    write_record(changed, tmp_path / "record.parquet")
    again = read_record(tmp_path / "record.parquet")
    assert again.same_bits(changed)
    assert again.metadata.segments == segments


def test_other_records_do_not_mention_it(make_record):
    data = record_bytes(make_record(rows=2)[0])
    assert b"demonstrator" not in data
    assert b"segments" not in data


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: SkillWindow("pick", "a", "", "", "", 3, 2, 5),
        lambda: SkillWindow("place", "a", "", "", "", 1, 4, 4),
        lambda: SubgoalSegment("s", "a", "b", "inside", "", 4, 4),
        lambda: Demonstrator("ghost", "x"),
    ],
)
def test_what_contradicts_itself_is_refused(wrong):
    with pytest.raises(InvalidInputError):
        wrong()
