"""A check of a data set names the file and the field that is not what the records say, in one line."""

from __future__ import annotations

import importlib.util
import io
import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image
from tests.daily import others_slow, part_of_today
from tests.looping import each

from betterbench.cli.main import main
from betterbench.demonstrations.export import (
    ExportPlan,
    check,
    check_export,
    export_dataset,
    job,
    layout_of,
    lerobot,
    select_demonstrations,
)
from betterbench.errors import BetterError, InvalidInputError, RecordError

sys.path.insert(0, str(Path(__file__).parent))
from demonstrating import PaintedPictures, twins_run

pytestmark = [pytest.mark.physics, pytest.mark.render, pytest.mark.usefixtures("painted")]

H5PY = importlib.util.find_spec("h5py") is not None
EXPORTS = {
    "v3": ("lerobot", "lerobot", {}),
    "png": ("lerobot", "lerobot", {"form": "png"}),
    "said": ("lerobot", "lerobot", {"language": True}),
    "held out": ("lerobot", "lerobot", {"validation": 0.5}),
    "gr00t": ("lerobot-v2.1", "gr00t_new_embodiment", {}),
    "libero": ("lerobot-v2.1", "openpi_libero", {"form": "png"}),
    "droid": ("lerobot-v2.1", "openpi_droid", {"validation": 0.5}),
    **({"hdf5": ("robomimic", "native", {})} if H5PY else {}),
    **({"hdf5 held out": ("robomimic", "native", {"validation": 0.5})} if H5PY else {}),
}
DATA, EPISODES = "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"
VIDEO = "videos/observation.images.front"


@pytest.fixture(scope="module")
def sets(demonstrations, tmp_path_factory) -> dict[str, Path]:
    """A data set of every kind, which nobody changed; each is made when a test first asks for it."""
    made, runs = tmp_path_factory.mktemp("sets"), [demonstrations.run]

    class Sets(dict):
        def __missing__(self, name):
            to, preset, options = EXPORTS[name]
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(job, "Pictures", PaintedPictures)
                chosen = select_demonstrations(runs)
                export_dataset(ExportPlan(runs, chosen, layout_of(preset), to, made / name, **options))
            self[name] = made / name
            return self[name]

    return Sets()


def copy_of(sets, name: str, tmp_path: Path) -> Path:
    out = tmp_path / f"changed{len([*tmp_path.iterdir()])}"
    return Path((shutil.copytree if sets[name].is_dir() else shutil.copy)(sets[name], out))


def fields(name, change):
    """Changes a file of JSON."""

    def changed(out: Path) -> None:
        form = json.loads((out / "meta" / name).read_text())
        change(form)
        (out / "meta" / name).write_text(json.dumps(form))

    return changed


def lines(name, change):
    """Changes a file of JSON lines."""

    def changed(out: Path) -> None:
        rows = [json.loads(line) for line in (out / "meta" / name).read_text().splitlines()]
        change(rows)
        (out / "meta" / name).write_text("".join(json.dumps(row) + "\n" for row in rows))

    return changed


def table(name, change):
    """Changes a file of Parquet."""

    def changed(out: Path) -> None:
        pq.write_table(change(pq.read_table(out / name)), out / name)

    return changed


def column(file, name, values):
    """Changes the values of one column, as NumPy knows them."""

    def changed(there: pa.Table) -> pa.Table:
        new = pa.array(values(there[name].to_numpy().copy()), there.schema.field(name).type)
        return there.set_column(there.column_names.index(name), name, new)

    return table(file, changed)


def rows(change):
    """Changes what version 3.0 says of its episodes."""

    def changed(there: pa.Table) -> pa.Table:
        listed = there.to_pylist()
        change(listed)
        return pa.Table.from_pylist(listed)

    return table(EPISODES, changed)


def row(number, **values):
    """Changes some fields of an episode of version 3.0; ``__`` stands for a slash."""
    return rows(lambda listed: listed[number].update({k.replace("__", "/"): v for k, v in values.items()}))


def of_video(number, **values):
    return rows(lambda listed: listed[number].update({f"{VIDEO}/{k}": v for k, v in values.items()}))


def actions(change):
    def changed(there: pa.Table) -> pa.Table:
        values = there["action"].combine_chunks().flatten().to_numpy().copy()
        change(values)
        new = pa.FixedSizeListArray.from_arrays(pa.array(values), 7)
        return there.set_column(there.column_names.index("action"), "action", new)

    return table(DATA, changed)


def rotated(there: pa.Table) -> pa.Table:
    return there.take([*range(4, len(there)), *range(4)])


def with_strangers(there: pa.Table) -> pa.Table:
    """Adds rows of an episode that does not exist."""
    place = there.column_names.index("episode_index")
    return pa.concat_tables([there, there.slice(0, 3).set_column(place, "episode_index", pa.array([77] * 3))])


def without_subgoals(there: pa.Table) -> pa.Table:
    place = there.column_names.index("language_persistent")
    field = there.schema.field(place)
    return there.set_column(place, field, pa.nulls(len(there), field.type))


def hdf5(change):
    """Changes an HDF5 file."""

    def changed(out: Path) -> None:
        import h5py

        with h5py.File(out, "r+") as file:
            change(file)

    return changed


def attribute(group, name, value):
    return hdf5(lambda file: file[group].attrs.__setitem__(name, value))


def json_attribute(group, name, **values):
    def changed(file) -> None:
        file[group].attrs[name] = json.dumps(json.loads(file[group].attrs[name]) | values)

    return hdf5(changed)


def array(name, change):
    def changed(file) -> None:
        values = change(file[name][()])
        del file[name]
        file[name] = values

    return hdf5(changed)


def origin(change):
    """Changes what an HDF5 file says about its origin."""

    def changed(file) -> None:
        form = json.loads(file["better"][()])
        change(form)
        del file["better"]
        file["better"] = json.dumps(form)

    return hdf5(changed)


def plus(number):
    def changed(values):
        values[-1] += number
        return values

    return changed


INFO, SOURCE, STATS = "info.json", "betterbench.json", "stats.json"
FRONT = "observation.images.front"
LINES = "episodes_stats.jsonl"
FIELDS = {
    "v3": (
        (fields(INFO, lambda f: f["features"]["action"].update(shape=[9])), r"shape\[0\] is 9, expected 7"),
        (fields(INFO, lambda f: f["features"]["action"]["names"].reverse()), r"features\.action\.names\[0\] is "),
        (fields(INFO, lambda f: f["features"].pop("action")), r"features\.action is absent, expected "),
        (fields(INFO, lambda f: f.update(data_path="x")), 'meta/info.json: data_path is "x", expected "data/'),
        (fields(INFO, lambda f: f.update(video_path=None)), "video_path is null, expected "),
        (fields(INFO, lambda f: f.update(fps=20.0)), "fps is 20.0, expected 20. Export the data set again"),
        (fields(INFO, lambda f: f.update(total_frames=1)), "total_frames is 1, expected 18"),
        (fields(INFO, lambda f: f.update(total_tasks=99)), "total_tasks is 99, expected 2"),
        (fields(INFO, lambda f: f.update(chunks_size=1)), "chunks_size is 1, expected 1000"),
        (fields(INFO, lambda f: f.update(robot_type="so100")), 'robot_type is "so100", expected "panda"'),
        (fields(INFO, lambda f: f.update(splits={})), "info.json: splits.train is None, but no validation"),
        (fields(INFO, lambda f: f.update(splits={"train": "0:3"})), r"splits\.train is 0:3, but no validation"),
        (fields(INFO, lambda f: f["splits"].update(validation="1:2")), r"splits\.validation is "),
        (fields(INFO, lambda f: f.pop("codebase_version")), r"meta: it is damaged \('codebase_version'\)"),
        (fields(INFO, lambda f: f.update(codebase_version="v2.1")), r"episodes\.jsonl: the file cannot be read"),
        (fields(STATS, lambda f: f["action"]["mean"].insert(0, 99.0)), r"stats\.json: action\.mean\[0\] is 99.0, exp"),
        (fields(STATS, lambda f: f["action"].update(std=[float("nan")] * 7)), r"action\.std\[0\] is NaN, expected"),
        (fields(STATS, lambda f: f["action"].pop("max")), r"action\.max is absent, expected"),
        (fields(STATS, lambda f: f[FRONT]["std"].pop()), r"the length of .*front\.std is 2, expected 3"),
        (fields(STATS, lambda f: f[FRONT].update(max=[[[255]]] * 3)), r'is 255, expected "a number from 0 to 1"'),
        (fields(STATS, lambda f: f[FRONT].update(count=[1])), r"front\.count\[0\] is 1, expected 18"),
        (fields(SOURCE, lambda f: f["episodes"][1].update(rows=3)), r"json: episodes\[1\]: rows is 3, expected 9"),
        (fields(SOURCE, lambda f: f["episodes"][0].update(instruction="x")), r'instruction is "x", expected '),
        (fields(SOURCE, lambda f: f["episodes"][0].update(pairs=["x"])), r"the length of pairs is 1, expected 0"),
        (fields(SOURCE, lambda f: f.update(policies=["me"])), r'betterbench\.json: policies\[0\] is "me", expected'),
        (fields(SOURCE, lambda f: f["layout"]["vectors"].pop("action")), r"layout\.vectors\.action is absent"),
        (row(1, dataset_from_index=0), "episode 1: dataset_from_index is 0, expected 9"),
        (row(0, dataset_to_index=5), r"file-000\.parquet: episode 0: dataset_to_index is 5, expected 9"),
        (row(0, length=8), "length is 8, expected 9"),
        (row(0, tasks=["x"]), r'tasks\[0\] is "x", expected '),
        (row(1, data__chunk_index=1), "data/chunk_index is 1, expected 0"),
        (row(1, data__file_index=2), "data/file_index is 2, expected 0"),
        (row(1, data__file_index=1), r"data/chunk-000/file-000.parquet: it has 18 rows, but 9 belong to episodes"),
        (row(0, stats__action__mean=[0.0] * 7), "stats/action/mean.* is 0.0, expected"),
        (row(0, better__record="0"), 'better/record is "0", expected '),
        (of_video(0, from_timestamp=0.05), "front/from_timestamp is 0.05, expected 0.0"),
        (of_video(1, to_timestamp=float("nan")), "front/to_timestamp is NaN, expected 0.9"),
        (of_video(1, from_timestamp=None), "front/from_timestamp is null, expected 0.45"),
        (of_video(1, chunk_index=3), "front/chunk_index is 3, expected 0"),
        (of_video(1, file_index=0.5), r"front/file_index is .*, expected 0"),
        (of_video(1, file_index=1, from_timestamp=0.0, to_timestamp=0.45), r"file-001\.mp4: the video cannot be read"),
        (table("meta/tasks.parquet", lambda t: t.take([1, 0])), r"meta/tasks\.parquet: rows\[0\]"),
        (table("meta/tasks.parquet", lambda t: t.replace_schema_metadata({})), "index is null, expected"),
        (table("meta/subtasks.parquet", lambda t: t.slice(1)), r"subtasks\.parquet: .*rows"),
        (lambda out: (out / "meta/tasks.parquet").unlink(), r"tasks\.parquet: the file cannot be read"),
        (lambda out: shutil.copy(out / DATA, out / "data/chunk-000/more.parquet"), "more.parquet: .*not belong to any"),
        (lambda out: shutil.copy(out / EPISODES, out / "meta/episodes/x.parquet"), r"x\.parquet: .*not belong to any"),
        (table(DATA, rotated), r"file-000\.parquet: episode 0: observation\.state\[0\]"),
        (table(DATA, with_strangers), r"file-000\.parquet: it has 21 rows, but 18 belong to episodes"),
        (table(DATA, lambda t: t.slice(0, 12)), "episode 1: it has 3 rows, expected 9"),
        (table(DATA, lambda t: t.append_column("x", t["index"])), r'columns: x is "int64", expected absent'),
        (table(DATA, lambda t: t.replace_schema_metadata({})), "schema: it is null, expected"),
        (actions(plus(0.01)), r"episode 1: action\[8\]\[6\] is "),
        (column(DATA, "task_index", lambda v: 1 - v), r"episode 0: task_index\[0\] is 1, expected 0"),
        (column(DATA, "subtask_index", lambda v: 0 * v + 99), r"subtask_index\[0\] is 99, expected"),
        (column(DATA, "timestamp", lambda v: 0 * v), r"timestamp\[1\] is 0.0, expected 0.05"),
        (column(DATA, "frame_index", lambda v: 0 * v + 7), r"frame_index\[0\] is 7, expected 0"),
        (column(DATA, "index", lambda v: v + 1), r"episode 0: index\[0\] is 1, expected 0"),
    ),
    "png": (
        (table(DATA, rotated), "episode 0: observation.images.front.0. is "),
        (fields(SOURCE, lambda f: f.update(images="video")), "chunk_index is absent, expected 0"),
        (fields(SOURCE, lambda f: f.update(images="gif")), "there are neither videos nor PNG files"),
    ),
    "said": (
        (fields(INFO, lambda f: [f["features"].pop(f"language_{n}") for n in ("persistent", "events")]), "columns: la"),
        (table(DATA, without_subgoals), r"episode 0: language_persistent\[0\] is null, expected"),
    ),
    "held out": (
        (fields(INFO, lambda f: f.update(splits={"train": "0:2"})), r"splits\.train is 0:2, but no validation"),
        (fields(INFO, lambda f: f["splits"].update(validation="0:2")), r"splits\.validation is .0:2., expected .1:2"),
    ),
    "gr00t": (
        (
            fields("modality.json", lambda f: f["action"]["ee_position"].update(start=3, end=6)),
            r"meta/modality\.json: action\.ee_position\.end is 6, expected 3",
        ),
        (fields("modality.json", lambda f: f["video"].popitem()), r"modality\.json: video\..* is absent"),
        (lambda out: (out / "meta/modality.json").unlink(), r"modality\.json: the file cannot be read"),
        (fields(INFO, lambda f: f.update(total_videos=77)), "total_videos is 77, expected 4"),
        (fields(INFO, lambda f: f.update(total_chunks=2)), "total_chunks is 2, expected 1"),
        (lines(LINES, lambda r: r[1]["stats"]["action"]["mean"].reverse()), r"line 2: stats\.action\.mean\[0\] is "),
        (lines(LINES, lambda r: r.pop()), "it lists only 1 of the episodes"),
        (lines(LINES, lambda r: r.append(r[0])), "it lists 3 episodes, but there are 2"),
        (lines("episodes.jsonl", lambda r: r[0].update(length=5)), "line 1: length is 5, expected 9"),
        (lines("episodes.jsonl", lambda r: r.reverse()), "line 1: episode_index is 1, expected 0"),
        (lines("tasks.jsonl", lambda r: r[0].update(task="x")), r'tasks\.jsonl: \[0\]\.task is "x", expected'),
        (fields(STATS, lambda f: f["action"].update(q50=[0.0] * 7)), r"action\.q50 is \[.*\], expected absent"),
        (
            table("data/chunk-000/episode_000001.parquet", lambda t: pa.concat_tables([t, t])),
            r"episode_000001\.parquet: it has 18 rows, but 9 belong to episodes",
        ),
        (
            lambda out: shutil.copy(out / "data/chunk-000/episode_000001.parquet", out / "data/chunk-000/z.parquet"),
            r"z\.parquet: .*not belong to any episode",
        ),
    ),
    "droid": (
        (
            lambda out: shutil.copy(
                next(out.rglob("wrist_image_left/*0.mp4")), next(out.rglob("exterior_image_2_left/*0.mp4"))
            ),
            "episode 0: its exterior_image_2_left differs at frame 0",
        ),
    ),
    "hdf5": (
        (array("mask/train", lambda v: v[:1]), "mask/train has 1 demonstrations, but no validation fraction splits"),
        (array("mask/train", lambda v: v[::-1]), r'mask: train\[0\] is "demo_1", expected "demo_0"'),
        (hdf5(lambda f: f["mask"].create_dataset("valid", data=f["mask/train"][:])), r"mask: valid is .* absent"),
        (hdf5(lambda f: f.pop("mask")), "mask: it is damaged"),
        (json_attribute("data", "env_args", type=1), r"data: env_args\.type is 1, expected 2"),
        (attribute("data", "env_args", "{"), "data: it is damaged"),
        (attribute("data", "total", 5), "data: total is 5, expected 18"),
        (attribute("data/demo_1", "num_samples", 5), "data/demo_1: num_samples is 5, expected 9"),
        (attribute("data/demo_0", "instruction", "x"), 'demo_0: instruction is "x", expected '),
        (attribute("data/demo_0", "mine", np.float32(1)), "demo_0: mine is 1.0, expected absent"),
        (json_attribute("data/demo_0", "better", seed=7), r"better\.seed is 7, expected 0"),
        (hdf5(lambda f: f["data/demo_0"].attrs.pop("num_samples")), "num_samples is absent, expected 9"),
        (hdf5(lambda f: f.copy("data/demo_0", "data/demo_2")), r'data: demo_2 is "there", expected absent'),
        (hdf5(lambda f: f.copy("data/demo_0/obs", "data/demo_0/next_obs")), "demo_0: next_obs is "),
        (array("data/demo_0/actions", plus(0.01)), r"demo_0: actions\[8\]\[0\] is "),
        (array("data/demo_0/actions", lambda v: v[:5]), 'actions is "5 x 7 float64", expected "9 x 7 float64"'),
        (array("data/demo_0/actions", lambda v: v.astype("f4")), 'actions is "9 x 7 float32", expected'),
        (array("data/demo_0/dones", lambda v: 0 * v), r"dones\[8\] is 0, expected 1"),
        (array("data/demo_0/rewards", lambda v: v + 1), r"rewards\[0\] is 1.0, expected 0.0"),
        (array("data/demo_0/subgoal", lambda v: np.full_like(v, b"x")), r'subgoal\[0\] is "x", expected'),
        (array("data/demo_0/obs/ee_position", lambda v: v + 1), r"obs/ee_position\[0\]\[0\] is "),
        (array("data/demo_0/obs/front", lambda v: v[:, :9]), 'obs/front is "9 x 9 x 256 x 3 uint8", expected'),
        (array("data/demo_0/obs/front", lambda v: 255 - v), "its observation.images.front differs at frame 0"),
        (hdf5(lambda f: f.pop("data/demo_0/obs/wrist")), "obs/wrist is absent"),
        (hdf5(lambda f: f.pop("data/demo_1")), "episode 1: it is damaged"),
        (origin(lambda s: s["episodes"][0].update(rows=3)), r"better: episodes\[0\]: rows is 3, expected 9"),
        (origin(lambda s: s.update(images="video")), r'better: images is "video", expected "png"'),
    ),
}  # fmt: skip
CASES = [(name, *case) for name, cases in FIELDS.items() if H5PY or name != "hdf5" for case in cases]


@pytest.mark.parametrize("name", others_slow(EXPORTS, 3))
def test_every_kind_of_data_set_that_nobody_changed_holds_what_the_records_say(demonstrations, sets, name):
    found = check_export([demonstrations.run], sets[name])
    assert (found.episodes, found.frames) == (2, 18)
    assert found.pictures == 6 * (3 if name == "droid" else 2)


@each("case", part_of_today(CASES, 9), lambda case: f"{case[0]}: {case[2]}")
def test_a_check_names_whatever_is_not_so(demonstrations, sets, tmp_path, case):
    """Every ninth change, others each day."""
    require_named(demonstrations, sets, tmp_path, case)


@pytest.mark.slow
@each("case", CASES, lambda case: f"{case[0]}: {case[2]}")
def test_a_check_names_each_of_the_changes(demonstrations, sets, tmp_path, case):
    require_named(demonstrations, sets, tmp_path, case)


def require_named(demonstrations, sets, tmp_path, case):
    name, change, said = case
    out = copy_of(sets, name, tmp_path)
    change(out)
    with pytest.raises(InvalidInputError, match=said) as told:
        check_export([demonstrations.run], out)
    assert "\n" not in str(told.value)
    assert str(out) in str(told.value)


def test_data_sets_of_several_files_are_read_where_their_episodes_lie(demonstrations, tmp_path, monkeypatch):
    monkeypatch.setattr(lerobot, "MOST_FILE_BYTES", 1)
    monkeypatch.setattr(lerobot, "CHUNK_FILES", 1)
    runs, out = [demonstrations.run], tmp_path / "set"
    export_dataset(ExportPlan(runs, select_demonstrations(runs), layout_of("lerobot"), "lerobot", out))
    assert (out / VIDEO / "chunk-001/file-000.mp4").is_file()
    assert check_export(runs, out).episodes == 2
    shutil.copy(out / DATA, out / "data/chunk-001/file-000.parquet")
    with pytest.raises(InvalidInputError, match=r"chunk-001/file-000\.parquet: episode 1: observation\.state\[0\]"):
        check_export(runs, out)


def test_a_check_needs_the_runs_of_all_records(demonstrations, sets):
    with pytest.raises(RecordError, match="none of the given runs has the record"):
        check_export([], sets["v3"])


def test_frames_that_unpack_to_too_much_are_not_read(demonstrations, sets, monkeypatch):
    monkeypatch.setattr("betterbench.demonstrations.export.lerobot_check.MAX_UNPACKED_BYTES", 100)
    with pytest.raises(InvalidInputError, match="unpacks to more than 100 bytes"):
        check_export([demonstrations.run], sets["v3"])


def test_an_unreadable_video_is_one_line_that_names_it(demonstrations, sets, tmp_path):
    out = copy_of(sets, "v3", tmp_path)
    video = next(out.rglob("*.mp4"))
    whole = video.read_bytes()
    (video.parent / "other.mp4").write_bytes(whole)
    for data in (whole[:300], b"ffconcat version 1.0\nfile other.mp4\n"):  # a list of other videos is no video
        video.write_bytes(data)
        with pytest.raises(
            InvalidInputError, match=r"file-000\.mp4: the video cannot be read \(.*\)\. Export the data set again"
        ):
            check_export([demonstrations.run], out)


@each("name", ["v3", "png", *(["hdf5"] if H5PY else [])])
def test_bytes_that_no_picture_shows_are_compared_with_their_digest(demonstrations, sets, tmp_path, name):
    out = copy_of(sets, name, tmp_path)
    if name == "v3":
        place = next(out.rglob("*.mp4"))
        data = bytearray(place.read_bytes())
        data[data.index(b"isom")] ^= 1  # a brand that no reader asks for
        place.write_bytes(data)
    elif name == "png":
        table(DATA, lambda t: one_picture(t, 5))(out)
    else:
        hdf5(lambda f: f["data/demo_0/obs/front"].__setitem__(5, 9))(out)
    with pytest.raises(BetterError, match="has changed since it was written"):
        check_export([demonstrations.run], out)


def one_picture(there, row, data=None):
    """Returns a table with another picture in one row, of which a check draws three of each episode."""
    place = there.column_names.index("observation.images.front")
    rows = there.column(place).to_pylist()
    rows[row]["bytes"] = rows[row - 1]["bytes"] if data is None else data
    return there.set_column(place, there.schema.field(place), pa.array(rows, there.schema.field(place).type))


EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n(ran) (w) file closefile showpage\n"


@each("data", [EPS, b"GIF89a" + bytes(40), b"\x89PNG\r\n\x1a\n" + bytes(40), b"", None], lambda d: ascii(d)[:16])
def test_a_picture_is_read_as_png_and_as_nothing_else(demonstrations, sets, tmp_path, data):
    if data is None:  # 14,000 x 14,000 pixels in 25 kB; one bit each, because eight take eight times as long to write
        buffer = io.BytesIO()
        Image.new("1", (14_000, 14_000)).save(buffer, "PNG", compress_level=1)
        data = buffer.getvalue()
    out = copy_of(sets, "png", tmp_path)
    table(DATA, lambda t: one_picture(t, 0, data))(out)
    with pytest.raises(InvalidInputError, match="is not a PNG file") as caught:
        check_export([demonstrations.run], out)
    assert len(str(caught.value).splitlines()) == 1


def test_twins_are_compared(demonstrations, tmp_path):
    run, _ = twins_run(tmp_path / "run", demonstrations)
    out = tmp_path / "set"
    export_dataset(ExportPlan([run], select_demonstrations([run]), layout_of("lerobot"), "lerobot", out))
    assert check_export([run], out).episodes == 2
    row(1, better__pairs="other")(out)
    with pytest.raises(InvalidInputError, match='better/pairs is "other", expected "it"'):
        check_export([run], out)


def with_link(name, kind, *place):
    """Replaces an object by a link."""

    def changed(file) -> None:
        import h5py

        if name in file:
            del file[name]
        file[name] = getattr(h5py, kind)(*place)

    return hdf5(changed)


def with_virtual(file) -> None:
    import h5py

    layout = h5py.VirtualLayout((9, 7), "f8")
    layout[...] = h5py.VirtualSource("other.hdf5", "data/demo_1/actions", (9, 7))
    del file["data/demo_0/actions"]
    file.create_virtual_dataset("data/demo_0/actions", layout)


STRANGE = {
    "a second demonstration by a link": (
        with_link("data/demo_2", "SoftLink", "/data/demo_0"),
        "demo_2 is a link",
    ),
    "another's demonstration": (
        with_link("data/demo_1", "ExternalLink", "x.hdf5", "/data"),
        "demo_1 is a link",
    ),
    "a pipe": (with_link("better", "ExternalLink", "pipe", "/x"), "better is a link"),
    "a pipe among the actions": (
        with_link("data/demo_0/actions", "ExternalLink", "pipe", "/x"),
        "actions is a link",
    ),
    "one array for two": (
        hdf5(lambda f: f["data/demo_1"].__setitem__("next", f["data/demo_0"])),
        "is another name of an earlier object",
    ),
    "a circle": (hdf5(lambda f: f["data"].__setitem__("demo_2", f["data"])), "is another name of an earlier object"),
    "a file of the user": (
        hdf5(lambda f: f.create_dataset("data/x", (4,), "u1", external=[("secret", 0, 4)])),
        "data/x is stored in another file",
    ),
    "an array of views": (hdf5(with_virtual), "actions is stored in another file"),
    "a terabyte": (
        hdf5(lambda f: f.create_dataset("data/x", (10**12,), "u1", chunks=(1 << 20,), compression="gzip")),
        "data/x declares 1000000000000 bytes",
    ),
    "a type": (hdf5(lambda f: f.__setitem__("kind", np.dtype("f8"))), "kind is neither a group nor an array"),
    "an attribute of the file": (hdf5(lambda f: f.attrs.__setitem__("total", 9)), "changed since it was"),
    "a digest of many": (
        hdf5(lambda f: f.attrs.__setitem__("better_sha256", np.zeros(3))),
        "changed since it was",
    ),
}


@pytest.mark.skipif(not H5PY, reason="needs h5py (extra robomimic)")
@each("name", [*STRANGE])
def test_what_we_never_write_into_an_hdf5_file_is_refused_and_not_followed(
    demonstrations, sets, tmp_path, name, monkeypatch
):
    """HDF5 opens what a link names, a pipe too, and fills memory with what no file holds."""
    from betterbench.demonstrations.export.robomimic import require_same_content

    out, (change, said) = copy_of(sets, "hdf5", tmp_path), STRANGE[name]
    monkeypatch.chdir(tmp_path)
    if not (tmp_path / "pipe").exists():
        os.mkfifo(tmp_path / "pipe")
    (tmp_path / "secret").write_bytes(b"abcd")
    shutil.copy(out, tmp_path / "other.hdf5")
    change(out)
    with pytest.raises(BetterError, match=said):
        require_same_content(out, cure="Move it away")
    with pytest.raises(BetterError) as caught:
        check_export([demonstrations.run], out)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.skipif(not H5PY, reason="needs h5py (extra robomimic)")
def test_a_file_of_robomimic_is_known_whatever_it_is_called(demonstrations, sets, tmp_path, capsys):
    assert sets["hdf5"].suffix == ""
    words = ["export", str(demonstrations.run.path), "--check"]
    assert main([*words, str(sets["hdf5"])]) == 0
    assert "agrees with the records: 2 episodes" in capsys.readouterr().out
    (tmp_path / "short.hdf5").write_bytes(sets["hdf5"].read_bytes()[:700])
    assert main([*words, str(tmp_path / "short.hdf5")]) == 2
    assert "this is not a data set of `better export`" in " ".join(capsys.readouterr().err.split())


def column_lost(name):
    return lambda path: pq.write_table(pq.read_table(path).drop_columns([name]), path)


def key_changed(name, value=None):
    return lambda path: path.write_text(json.dumps({**json.loads(path.read_bytes()), name: value}))


def text(said):
    return lambda path: path.write_bytes(said)


DAMAGE = (
    (DATA, column_lost("action")),
    (DATA, column_lost("episode_index")),
    (DATA, lambda path: pq.write_table(pq.read_table(path).slice(0, 5), path)),
    (DATA, lambda path: pq.write_table(pa.table({"action": [b"x"]}), path)),
    (DATA, text(b"PAR1")),
    (EPISODES, column_lost("data/file_index")),
    (EPISODES, column_lost(f"{VIDEO}/from_timestamp")),
    (EPISODES, lambda path: pq.write_table(pq.read_table(path).slice(0, 1), path)),
    (EPISODES, lambda path: pq.write_table(pa.table({"length": pa.array([b"\xff", b"x"])}), path)),
    (EPISODES, text(b"")),
    ("meta/tasks.parquet", lambda path: pq.write_table(pa.table({"task": [b"\xff"]}), path)),
    ("meta/tasks.parquet", lambda path: pq.write_table(pa.table({"task": ["x"]}, metadata={"pandas": "["}), path)),
    ("meta/info.json", text(b"[]")),
    ("meta/info.json", text(b"{")),
    ("meta/info.json", text(b"[" * 100_000)),
    ("meta/info.json", key_changed("features", 5)),
    ("meta/info.json", key_changed("splits", {"train": "0:" + "9" * 5000})),
    ("meta/info.json", key_changed("a\nb\x1b[31m", "x\ny")),
    ("meta/stats.json", text(b"[NaN]")),
    ("meta/stats.json", text(b"\xff")),
    ("meta/stats.json", key_changed("action", {"mean": [1e999]})),
    ("meta/betterbench.json", text(b"{}")),
    ("meta/betterbench.json", key_changed("episodes")),
    ("meta/betterbench.json", key_changed("episodes", [])),
    ("meta/betterbench.json", key_changed("episodes", [{"seed": float("inf"), "rows": 1}])),
    ("meta/betterbench.json", key_changed("layout")),
    (f"{VIDEO}/chunk-000/file-000.mp4", lambda path: path.unlink()),
)  # fmt: skip


@pytest.mark.parametrize("damages", [part_of_today(DAMAGE, 3), pytest.param(DAMAGE, marks=pytest.mark.slow)], ids=len)
def test_whatever_a_data_set_has_lost_a_check_is_one_line(demonstrations, sets, tmp_path, damages):
    out = copy_of(sets, "v3", tmp_path)
    for number, (name, damage) in enumerate(damages):
        whole = (out / name).read_bytes()
        damage(out / name)
        with pytest.raises(InvalidInputError) as told:
            check_export([demonstrations.run], out)
        assert "\n" not in str(told.value), (number, name)
        assert "\x1b" not in str(told.value), (number, name)
        (out / name).write_bytes(whole)
    check.check_export([demonstrations.run], out)
