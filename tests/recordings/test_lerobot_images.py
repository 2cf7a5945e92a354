"""LeRobotDatasets whose pictures are stored one by one, as files within the tables of rows."""

import io
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from lerobot_v21 import CAMERA, DATA, INFO, write_v21
from matplotlib.image import imsave
from test_lerobot_v21 import message

from simtune.cameras.footage import Footage
from simtune.errors import InputError
from simtune.recordings import open_dataset, write_dataset
from simtune.recordings.lerobot.images import stored_pictures
from simtune.recordings.still import decode_picture
from simtune.trajectory import Trajectory

FPS, NUM_ROWS = 10, (12, 8, 10)
V3_DATA = "data/chunk-000/file-000.parquet"
IMAGE_FEATURE = {"dtype": "image", "shape": [32, 32, 3], "names": ["height", "width", "channels"]}


def drawn() -> list[np.ndarray]:
    """Of each episode, (T, 32, 32, 3)."""
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (num, 32, 32, 3), dtype=np.uint8) for num in NUM_ROWS]


def cell(picture: np.ndarray, kind: str = "png") -> dict[str, Any]:
    """As lerobot stores it."""
    file = io.BytesIO()
    imsave(file, picture, format=kind)
    return {"bytes": file.getvalue(), "path": f"frame.{kind}"}


def with_pictures(path: Path, cells: list[Any], **options: Any) -> None:
    """Put them into a table of rows."""
    kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    table = pq.read_table(path).append_column(CAMERA, pa.array(cells, kind))
    pq.write_table(table, path, **options)


def edit_features(folder: Path, **features: Any) -> None:
    info = json.loads((folder / INFO).read_text())
    info["features"] |= features
    (folder / INFO).write_text(json.dumps(info | {"video_path": None}))


def write_v3(folder: Path, cells: list[Any], side: int = 0, **options: Any) -> Path:
    """With videos of a second camera, of pictures of this side, where one is given."""
    rng = np.random.default_rng(1)
    episodes = [
        Trajectory(
            np.zeros((num, side, side, 3), np.uint8),
            rng.normal(size=(num - 1, 2)).astype(np.float32),
            1 / FPS,
        )
        for num in NUM_ROWS
    ]
    write_dataset(folder, episodes, action_names=["a", "b"], robot_type="arm", task="push")
    with_pictures(folder / V3_DATA, cells, **options)
    edit_features(folder, **{CAMERA: IMAGE_FEATURE})
    return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """In row groups that begin and end within episodes."""
    cells = [cell(picture) for pictures in drawn() for picture in pictures]
    return write_v3(tmp_path_factory.mktemp("v3") / "dataset", cells, row_group_size=7)


@pytest.fixture
def dataset(written: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(written, tmp_path / "dataset"))


def test_pictures_come_as_they_were_stored(written: Path):
    dataset = open_dataset(written)
    for episode in (2, 0, 1):
        trajectory = dataset.read(episode)
        np.testing.assert_array_equal(trajectory.frames, drawn()[episode])
        assert len(trajectory.actions) == NUM_ROWS[episode] - 1
    (camera,) = dataset.facts(3)["cameras"]
    assert (camera["key"], camera["codec"], camera["source_size"]) == (CAMERA, "png", [32, 32])
    assert dataset.reading_names == ()


def test_of_an_older_version(tmp_path: Path):
    folder, rng = tmp_path / "dataset", np.random.default_rng(0)
    columns = [{"action": rng.normal(size=(num, 2))} for num in NUM_ROWS]
    write_v21(folder, columns, {"action": ["a", "b"]}, fps=FPS)
    for episode, pictures in enumerate(drawn()):
        cells = [cell(picture) for picture in pictures]
        with_pictures(folder / DATA.format(chunk=0, episode=episode), cells)
    edit_features(folder, **{CAMERA: IMAGE_FEATURE})
    for episode, pictures in enumerate(drawn()):
        np.testing.assert_array_equal(open_dataset(folder).read(episode).frames, pictures)


def test_pictures_may_be_jpeg(tmp_path: Path):
    flat = [np.full((32, 32, 3), 8 * t, np.uint8) for t in range(sum(NUM_ROWS))]
    folder = write_v3(tmp_path / "dataset", [cell(picture, "jpeg") for picture in flat])
    found = open_dataset(folder)
    assert np.abs(found.read(1).frames.astype(int) - flat[12:20]).max() <= 1
    found.skim(0)
    assert found.facts(1)["cameras"][0]["codec"] == "jpeg"


@pytest.mark.parametrize("share", [0.5, 0.8, 0.95, 0.99])
def test_a_jpeg_that_is_cut_is_refused(share: float):
    """FFmpeg makes the rest grey, and says nothing."""
    content = cell(drawn()[0][0], "jpeg")["bytes"]
    with pytest.raises(InputError, match="a picture is damaged; copy the file again"):
        decode_picture(content[: int(share * len(content))])


def test_a_jpeg_may_be_padded_or_show_itself_small_in_its_header():
    picture = drawn()[0][0]
    content, small = cell(picture, "jpeg")["bytes"], cell(picture[:8, :8], "jpeg")["bytes"]
    exif = b"\xff\xe1" + (len(small) + 2).to_bytes(2, "big") + small
    expected = decode_picture(content)
    assert expected.shape == picture.shape
    for other in (content + bytes(64), content + small[2:-2], content[:2] + exif + content[2:]):
        np.testing.assert_array_equal(decode_picture(other), expected)
    with pytest.raises(InputError, match="damaged"):
        decode_picture(content[:2] + exif + content[2:-9])


def test_without_the_first_episode_its_damaged_picture_is_not_read(tmp_path: Path):
    cells = [cell(picture) for pictures in drawn() for picture in pictures]
    folder = write_v3(tmp_path / "dataset", [{"bytes": b"GIF89a", "path": "x"}, *cells[1:]])
    assert message(folder).startswith("episode 0, step 0: HERE")
    others = open_dataset(folder, leave_out=["0"])
    np.testing.assert_array_equal(others.read(0).frames, drawn()[1])
    assert others.facts(1)["cameras"][0]["codec"] == "png"


def test_a_picture_of_another_size_is_named(tmp_path: Path):
    cells = [cell(picture) for pictures in drawn() for picture in pictures]
    cells[5] = cell(drawn()[0][5][:16, :16])
    folder = write_v3(tmp_path / "dataset", cells)
    assert message(folder).startswith(
        "HERE: episode 0, step 5: a picture of 16×16 pixels, the first of episode 0 has 32×32"
    )


@pytest.mark.parametrize("hz", [5.0, 20.0])
def test_at_another_rate_frames_are_the_nearest(written: Path, hz: float):
    frames = open_dataset(written, control_hz=hz).read(1).frames
    rows = np.rint(np.arange(len(frames)) * FPS / hz).astype(int)
    np.testing.assert_array_equal(frames, drawn()[1][rows])


def test_rows_may_have_been_cut_off_at_an_episodes_beginning(dataset: Path):
    """Their time stamps go on from there, and so do the pictures."""
    path, cut = dataset / V3_DATA, 3
    pq.write_table(pq.read_table(path).slice(cut), path)
    table = pq.read_table(path)
    rows = np.arange(len(table))
    frame_index = np.array(table["frame_index"]) - cut * (rows < NUM_ROWS[0] - cut)
    place = table.column_names.index("frame_index")
    pq.write_table(table.set_column(place, "frame_index", pa.array(frame_index)), path)
    for file in (dataset / "meta/episodes").rglob("*.parquet"):
        listed = pq.read_table(file).to_pylist()
        listed[0]["length"] -= cut
        for row in listed:
            row.pop("dataset_from_index")
        pq.write_table(pa.Table.from_pylist(listed), file)
    np.testing.assert_array_equal(open_dataset(dataset).read(0).frames, drawn()[0][cut:])


def test_beside_a_camera_with_videos(tmp_path: Path):
    cells = [cell(picture) for pictures in drawn() for picture in pictures]
    folder = write_v3(tmp_path / "dataset", cells, side=32)
    with pytest.raises(InputError, match="has several cameras"):
        open_dataset(folder)
    shown = open_dataset(folder, cameras=[Footage(key="front"), Footage(key="camera0")]).read(0)
    np.testing.assert_array_equal(shown.frames[:, :, :32], drawn()[0])
    assert shown.frames[:, :, 32:].max() < 5


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda c: None, "row 14 has no bytes of a picture in column"),
        (lambda c: c | {"bytes": None}, "row 14 has no bytes of a picture in column"),
        (lambda c: c | {"bytes": b"#EXTM3U\n/etc/passwd"}, "row 14: a picture is neither PNG nor"),
        (lambda c: c | {"bytes": c["bytes"][:900]}, "row 14: a picture cannot be decoded ("),
    ],
)
def test_a_picture_missing_or_damaged(dataset: Path, spoil, said: str):
    table = pq.read_table(dataset / V3_DATA)
    cells = table[CAMERA].to_pylist()
    cells[14] = spoil(cells[14])
    pq.write_table(table.drop_columns([CAMERA]), dataset / V3_DATA)
    with_pictures(dataset / V3_DATA, cells)
    assert message(dataset).startswith(f"episode 1, step 2: HERE/{V3_DATA}: {said}")


def test_rows_out_of_order(dataset: Path):
    table = pq.read_table(dataset / V3_DATA)
    pq.write_table(table.take([1, 0, *range(2, len(table))]), dataset / V3_DATA)
    assert "rows of episode 0 are not in order, and hold its pictures" in message(dataset)


def test_no_such_column(dataset: Path):
    table = pq.read_table(dataset / V3_DATA).drop_columns([CAMERA])
    pq.write_table(table, dataset / V3_DATA)
    assert f"HERE/{V3_DATA}: no column '{CAMERA}'; there are: " in message(dataset)
    numbers = table.append_column(CAMERA, pa.array(range(len(table))))
    pq.write_table(numbers, dataset / V3_DATA)
    assert f"HERE/{V3_DATA}: expected pictures in column '{CAMERA}', as bytes" in message(dataset)


def test_a_few_pictures_are_in_memory_at_once(tmp_path: Path):
    rng, path = np.random.default_rng(0), tmp_path / "rows.parquet"
    contents = [rng.bytes(100_000) for _ in range(200)]
    pq.write_table(pa.table({"row": pa.array(range(200))}), path)
    with_pictures(path, [{"bytes": c, "path": None} for c in contents], write_batch_size=8)
    before, most = pa.total_allocated_bytes(), 0
    for row, content in zip(
        range(50, 200), stored_pictures(path, CAMERA, range(50, 200)), strict=True
    ):
        assert content == contents[row]
        most = max(most, pa.total_allocated_bytes() - before)
    assert most < 8e6  # of 20 MB in one row group; pages and threads need some
