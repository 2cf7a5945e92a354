"""Recordings: what is written comes back, and what is unsound is said in one line."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from av.video.reformatter import Interpolation

from simtune.cameras.footage import Footage
from simtune.cameras.pictures import resize
from simtune.errors import InputError
from simtune.real import RealWorld
from simtune.real.recorded import RecordedReal
from simtune.recordings import decode, open_dataset, write_dataset, write_video
from simtune.recordings.video import codec_of, frames_at
from simtune.trajectory import Trajectory

SIZE = 32  # pixels
NUM_STEPS = (11, 7, 9)  # of the episodes; one row more each
FPS = 10.0
X264 = "bframes=3:b-adapt=0:scenecut=0"  # always three B-frames
VIDEO = "videos/observation.images.camera0/chunk-000/file-000.mp4"
DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
INFO = "meta/info.json"


def picture(number: int, size: int = SIZE) -> np.ndarray:
    """A smooth picture that carries a number below 256 as eight dark or bright bars."""
    ramp = np.linspace(60, 190, size)
    frame = np.stack(
        [ramp + 0 * ramp[:, None], ramp[:, None] + 0 * ramp, 120 + 0 * ramp * ramp[:, None]], -1
    )
    for bit in range(8):
        width = size // 8
        frame[: size // 2, bit * width : (bit + 1) * width] = 220 if number >> bit & 1 else 30
    return frame.astype(np.uint8)


def number(frame: np.ndarray) -> int:
    """The number that `picture` put in."""
    bars = frame[: len(frame) // 2].mean((0, 2)).reshape(8, -1).mean(1)
    return sum(1 << bit for bit in range(8) if bars[bit] > 125)


def make_trajectories(num_actions: int = 2, first: int = 0) -> list[Trajectory]:
    rng = np.random.default_rng(first)
    trajectories = []
    for num_steps in NUM_STEPS:
        frames = np.stack([picture(first + index) for index in range(num_steps + 1)])
        actions = rng.uniform(-1, 1, (num_steps, num_actions)).astype(np.float32)
        trajectories.append(Trajectory(frames, actions, 1 / FPS))
        first += num_steps + 1
    return trajectories


def write(folder: Path, trajectories: list[Trajectory]) -> None:
    names = [f"joint_{index}" for index in range(trajectories[0].actions.shape[1])]
    write_dataset(folder, trajectories, action_names=names, robot_type="arm", task="swing it")


@dataclass
class Recording:
    trajectories: list[Trajectory]
    facts: dict[str, Any]


def read_dataset(folder: Path, max_episodes: int | None = None, **options: Any) -> Recording:
    dataset = open_dataset(folder, **options)
    num_episodes = max_episodes or dataset.num_episodes
    trajectories = [dataset.read(episode) for episode in range(num_episodes)]
    return Recording(trajectories, dataset.facts(num_episodes))


def facts_of(folder: Path, camera: str) -> dict[str, Any]:
    recording = read_dataset(folder, max_episodes=1, cameras=[Footage(key=camera)])
    return recording.facts["cameras"][0]


def dataset_hash(folder: Path) -> str:
    return open_dataset(folder).content_hash


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("written") / "dataset"
    write(folder, make_trajectories())
    return folder


@pytest.fixture
def dataset(written: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(written, tmp_path / "dataset"))


def edit_info(folder: Path, **changes: object) -> None:
    """Change meta/info.json; None removes a key."""
    path = folder / INFO
    info = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({key: value for key, value in info.items() if value is not None}))


def edit_table(path: Path, edit: Callable[[list[dict]], list[dict]]) -> None:
    pq.write_table(pa.Table.from_pylist(edit(pq.read_table(path).to_pylist())), path)


def edit_features(folder: Path, **features: object) -> None:
    known = json.loads((folder / INFO).read_text())["features"]
    edit_info(folder, features=known | features)


# --- reading what was written -------------------------------------------------------------


@pytest.mark.parametrize("num_actions", [1, 2, 6])
def test_round_trip(tmp_path: Path, num_actions: int):
    trajectories = make_trajectories(num_actions)
    write(tmp_path / "dataset", trajectories)
    recording = read_dataset(tmp_path / "dataset", num_actions=num_actions)
    assert len(recording.trajectories) == len(trajectories)
    for got, expected in zip(recording.trajectories, trajectories, strict=True):
        assert got.step_s == pytest.approx(1 / FPS)
        np.testing.assert_array_equal(got.actions, expected.actions)
        assert got.actions.dtype == np.float32
        assert [number(frame) for frame in got.frames] == [number(f) for f in expected.frames]
        assert np.abs(got.frames.astype(float) - expected.frames).mean() < 3


def test_facts(written: Path):
    facts = read_dataset(written, max_episodes=2, image_size=16).facts
    assert json.loads(json.dumps(facts)) == {
        "folder": str(written),
        "kind": "LeRobotDataset v3.0",
        "dataset_hash": dataset_hash(written),
        "robot_type": "arm",
        "cameras": [
            {
                "key": "observation.images.camera0",
                "codec": "h264",
                "source_size": [SIZE, SIZE],
                "image_size": [16, 16],
                "time_error_ms": {"largest": 0.0, "mean": 0.0},
                "frame_ms": None,
            }
        ],
        "fps": FPS,
        "control_hz": FPS,
        "readings_hz": 0.0,
        "action_names": ["joint_0", "joint_1"],
        "action_ranges": {
            name: [pytest.approx(actions.min()), pytest.approx(actions.max())]
            for name, actions in zip(
                ("joint_0", "joint_1"),
                np.concatenate([t.actions for t in make_trajectories()[:2]]).T,
                strict=True,
            )
        },
        "gaps": {},
        "unused_s": {},
        "unfilmed": {},
        "readings": {},
        "names": ["episode 0", "episode 1"],
        "episodes": 2,
        "episodes_in_dataset": 3,
        "left_out": 0,
        "names_left_out": [],
        "steps": 18,
    }


def test_hash_follows_content(dataset: Path):
    before = dataset_hash(dataset)
    assert before == dataset_hash(dataset)
    (dataset / "README.md").write_text("not part of the dataset")
    assert before == dataset_hash(dataset)
    edit_info(dataset, fps=20)
    assert before != dataset_hash(dataset)
    edit_info(dataset, fps=10)
    before = dataset_hash(dataset)
    write_video(dataset / VIDEO, (picture(index) for index in range(31)), FPS)
    assert before != dataset_hash(dataset)


def test_several_files_and_chunks(dataset: Path, tmp_path: Path):
    """A second dataset's files appended to the first, as lerobot does when a file is full."""
    write(tmp_path / "second", make_trajectories(first=100))
    for file in (VIDEO, DATA):
        target = dataset / file.replace("chunk-000/file-000", "chunk-001/file-002")
        target.parent.mkdir(parents=True)
        shutil.copy(tmp_path / "second" / file, target)
    moved = {"episode_index": lambda row: row["episode_index"] + 3}
    edit_table(
        dataset / DATA.replace("chunk-000/file-000", "chunk-001/file-002"),
        lambda rows: [row | {k: f(row) for k, f in moved.items()} for row in rows],
    )
    second = pq.read_table(tmp_path / "second" / EPISODES).to_pylist()
    for row in second:
        row["episode_index"] += 3
        for key in ("data", "videos/observation.images.camera0"):
            row |= {f"{key}/chunk_index": 1, f"{key}/file_index": 2}
    edit_table(dataset / EPISODES, lambda rows: [*second, *rows])
    edit_info(dataset, total_episodes=6)
    recording = read_dataset(dataset)
    expected = make_trajectories() + make_trajectories(first=100)
    assert [len(t) for t in recording.trajectories] == [len(t) for t in expected]
    for got, trajectory in zip(recording.trajectories, expected, strict=True):
        np.testing.assert_array_equal(got.actions, trajectory.actions)
        assert [number(frame) for frame in got.frames] == [number(f) for f in trajectory.frames]


def test_rows_out_of_order_are_sorted(dataset: Path):
    edit_table(dataset / DATA, lambda rows: rows[::-1])
    for got, expected in zip(read_dataset(dataset).trajectories, make_trajectories(), strict=True):
        np.testing.assert_array_equal(got.actions, expected.actions)


def test_second_camera(dataset: Path):
    first, second = "observation.images.camera0", "observation.images.wrist"
    shutil.copytree(dataset / "videos" / first, dataset / "videos" / second)
    features = json.loads((dataset / INFO).read_text())["features"]
    edit_features(dataset, **{second: features[first]})
    edit_table(
        dataset / EPISODES,
        lambda rows: [row | {k.replace(first, second): row[k] for k in row} for row in rows],
    )
    with pytest.raises(InputError, match=rf"by --camera, or name them .*: {first}, {second}"):
        read_dataset(dataset)
    for name in ("wrist", second):
        assert facts_of(dataset, name)["key"] == second


def test_long_steps_do_not_show_the_next_episodes_first_frame(tmp_path: Path):
    actions = np.zeros((119, 1), np.float32)
    frames = np.stack([picture(index) for index in range(240)])
    episodes = [Trajectory(half, actions, 1 / 60) for half in np.split(frames, 2)]
    write(tmp_path / "dataset", episodes)
    read = read_dataset(tmp_path / "dataset", control_hz=1).trajectories
    assert [[number(frame) for frame in its.frames] for its in read] == [[0, 60], [120, 180]]


def cut_off(rows: list[dict], episode: int, num: int) -> list[dict]:
    """Without an episode's first rows; the others keep their moments in its video."""
    ours = [row for row in rows if row["episode_index"] == episode]
    kept = [row | {key: row[key] - num for key in ("frame_index", "index")} for row in ours[num:]]
    return [row for row in rows if row["episode_index"] != episode] + kept


def test_an_episode_without_its_first_rows_shows_the_frames_of_those_that_are_left(dataset: Path):
    edit_table(dataset / DATA, lambda rows: cut_off(rows, episode=1, num=3))
    edit_table(dataset / EPISODES, lambda rows: [rows[0], rows[1] | {"length": 5}, rows[2]])
    whole = make_trajectories()[1]
    recording = read_dataset(dataset)
    np.testing.assert_array_equal(recording.trajectories[1].actions, whole.actions[3:])
    assert [number(frame) for frame in recording.trajectories[1].frames] == list(range(15, 20))
    assert recording.facts["cameras"][0]["time_error_ms"]["largest"] < 0.01


def test_unread_columns_do_not_matter(dataset: Path):
    unread = {"next.reward": 1.0, "observation.state": [0.0], "action.note": "a name's beginning"}
    edit_table(dataset / DATA, lambda rows: [row | unread for row in rows])
    trajectory = read_dataset(dataset).trajectories[0]
    assert set(vars(trajectory)) == {"frames", "actions", "step_s", "readings"}
    assert not trajectory.readings


# --- writing --------------------------------------------------------------------------------


def test_layout(written: Path):
    info = json.loads((written / INFO).read_text())
    assert info["codebase_version"] == "v3.0"
    assert info["fps"] == 10
    assert isinstance(info["fps"], int)
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (3, 30, 1)
    assert info["splits"] == {"train": "0:3"}
    assert info["features"]["action"]["names"] == ["joint_0", "joint_1"]
    files = {path.relative_to(written).as_posix() for path in written.rglob("*.*")}
    assert files >= {INFO, "meta/stats.json", "meta/tasks.parquet", EPISODES, DATA, VIDEO}
    rows = pq.read_table(written / DATA)
    assert rows.schema.field("action").type == pa.list_(pa.field("element", pa.float32()), 2)
    assert rows["index"].to_pylist() == list(range(30))
    assert rows["action"][11] == rows["action"][10]  # the last row repeats the action
    episodes = pq.read_table(written / EPISODES).to_pylist()
    assert [row["dataset_from_index"] for row in episodes] == [0, 12, 20]
    key = "videos/observation.images.camera0"
    assert [row[f"{key}/from_timestamp"] for row in episodes] == [0.0, 1.2, 2.0]
    assert [row[f"{key}/to_timestamp"] for row in episodes] == [1.2, 2.0, 3.0]
    tasks = pq.read_table(written / "meta/tasks.parquet")
    assert tasks.to_pylist() == [{"task_index": 0, "__index_level_0__": "swing it"}]


def test_stats(written: Path):
    stats = json.loads((written / "meta/stats.json").read_text())
    trajectories = make_trajectories()
    pixels = np.concatenate([t.frames.reshape(-1, 3) for t in trajectories]) / 255
    colours = stats["observation.images.camera0"]
    assert np.shape(colours["mean"]) == (3, 1, 1)
    for name in ("min", "max", "mean", "std"):
        np.testing.assert_allclose(np.ravel(colours[name]), getattr(pixels, name)(0), atol=1e-6)
    np.testing.assert_allclose(
        np.ravel(colours["q90"]), np.quantile(pixels, 0.9, axis=0), atol=1 / 255
    )
    actions = np.concatenate([[*t.actions, t.actions[-1]] for t in trajectories])
    np.testing.assert_allclose(stats["action"]["mean"], actions.mean(0), atol=1e-6)
    assert stats["action"]["count"] == [30]
    assert stats["index"]["max"] == [29]
    episode = pq.read_table(written / EPISODES).to_pylist()[1]
    np.testing.assert_allclose(episode["stats/action/max"], trajectories[1].actions.max(0))


def test_existing_folder_is_refused(dataset: Path, tmp_path: Path):
    before = dataset_hash(dataset)
    with pytest.raises(InputError, match="exists already and is not empty; choose another name"):
        write(dataset, make_trajectories())
    assert before == dataset_hash(dataset)
    (tmp_path / "empty").mkdir()
    write(tmp_path / "empty", make_trajectories())
    assert open_dataset(tmp_path / "empty").num_episodes == 3


@pytest.mark.parametrize("out", [".", "link"])
def test_an_empty_folder_is_filled_where_it_is(
    tmp_path: Path, out: str, monkeypatch: pytest.MonkeyPatch
):
    target = tmp_path / "empty"
    target.mkdir()
    monkeypatch.chdir(target if out == "." else tmp_path)
    (tmp_path / "link").symlink_to("empty")
    write(Path(out), make_trajectories())
    assert open_dataset(out).num_episodes == 3  # also by who is in it
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "link"]
    assert sorted(path.name for path in target.iterdir()) == ["data", "meta", "videos"]


def test_nothing_is_left_of_a_failed_write(tmp_path: Path):
    def failing() -> Iterator[Trajectory]:
        yield make_trajectories()[0]
        raise RuntimeError("the robot fell over")

    with pytest.raises(RuntimeError, match="fell over"):
        write_dataset(
            tmp_path / "dataset", failing(), action_names="ab", robot_type="arm", task="swing"
        )
    assert list(tmp_path.iterdir()) == []


def test_misfits_are_refused(tmp_path: Path):
    good, bad = make_trajectories(2)[0], make_trajectories(3)[0]
    with pytest.raises(ValueError, match=r"trajectory 1: expected actions \(T, 2\)"):
        write(tmp_path / "dataset", [good, bad])
    slow = Trajectory(good.frames, good.actions, 0.5)
    with pytest.raises(ValueError, match=r"trajectory 1: expected frames .* every 0.1 s"):
        write(tmp_path / "dataset", [good, slow])
    nan = Trajectory(good.frames, np.full_like(good.actions, np.nan), good.step_s)
    with pytest.raises(ValueError, match="trajectory 1: actions are not all finite"):
        write(tmp_path / "dataset", [good, nan])
    odd = Trajectory(good.frames[:, 1:], good.actions, good.step_s)
    with pytest.raises(InputError, match="31×32 pixels do not fit h264 video; choose an even"):
        write(tmp_path / "dataset", [odd])
    with pytest.raises(ValueError, match="at least one trajectory"):
        write_dataset(tmp_path / "dataset", [], action_names="a", robot_type="arm", task="swing")


# --- video ----------------------------------------------------------------------------------


def pts_and_dts(path: Path) -> tuple[list, list]:
    with av.open(str(path)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.pts is not None]
    return [packet.pts for packet in packets], [packet.dts for packet in packets]


def write_reordered(path: Path, num_frames: int, options: dict[str, str]) -> None:
    """A video that uses B-frames, so that frames are stored in another order than shown."""
    with av.open(str(path), "w", options=options) as container:
        stream = container.add_stream("libx264", rate=10, options={"x264-params": X264})
        stream.width = stream.height = SIZE
        stream.pix_fmt = "yuv420p"
        for index in range(num_frames):
            frame = av.VideoFrame.from_ndarray(picture(index), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def test_colours_of_hdr_are_refused(tmp_path: Path):
    path = tmp_path / "phone.mov"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "yuv420p"
        stream.codec_context.color_trc = 18  # HLG
        container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(0), format="rgb24")))
        container.mux(stream.encode(None))
    with pytest.raises(InputError, match="its colours are HDR"):
        list(decode(path))


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda content: content.replace(b"Ubung", b"\xdcbung"), None),  # Latin-1
        (lambda content: content.replace(b"avc1", b"zzzz"), "no decoder for its codec; convert it"),
    ],
)
def test_titles_and_codecs_of_any_kind(tmp_path: Path, spoil: Callable, complaint: str | None):
    path = tmp_path / "video.mp4"
    with av.open(str(path), "w") as container:
        container.metadata["title"] = "Ubung"
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "yuv420p"
        container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(3), format="rgb24")))
        container.mux(stream.encode(None))
    path.write_bytes(spoil(path.read_bytes()))
    if complaint is None:
        assert [number(frame) for _, frame in decode(path)] == [3]
        assert number(Footage(background=path).plate([], (SIZE, SIZE))) == 3
    else:
        with pytest.raises(InputError, match=rf"video\.mp4: {complaint}"):
            codec_of(path)


@pytest.mark.parametrize("options", [{}, {"use_editlist": "0"}])
def test_b_frames_are_shown_in_order(tmp_path: Path, options: dict[str, str]):
    path = tmp_path / "video.mp4"
    write_reordered(path, 40, options)
    pts, _ = pts_and_dts(path)
    assert pts != sorted(pts)  # there are B-frames
    if options:
        assert min(pts) > 0  # and the file starts late
    shown = [(round(time_s, 6), number(frame)) for time_s, frame in decode(path)]
    assert shown == [(index / 10, index) for index in range(40)]
    for times_s, numbers in (
        ([0.96, 1.0, 2.04, 3.9], [10, 10, 20, 39]),
        ([2.51, 2.51, 2.6], [25, 25, 26]),
        ([], []),
    ):
        frames = list(frames_at(path, times_s, tolerance_s=0.05))
        assert [number(frame) for _, frame in frames] == numbers
        assert [round(10 * shown_s, 4) for shown_s, _ in frames] == numbers
    with pytest.raises(InputError, match=r"ends at 3.9 s, and a row asks for the frame at 3.96 s"):
        list(frames_at(path, [3.9, 3.96], tolerance_s=0.05))


def test_dataset_with_b_frames(dataset: Path):
    write_reordered(dataset / VIDEO, 30, {"use_editlist": "0"})
    numbers = [number(f) for t in read_dataset(dataset).trajectories for f in t.frames]
    assert numbers == list(range(30))


def test_video_faster_than_the_dataset(dataset: Path):
    """A camera at twice the control rate: every second frame is a row."""
    write_video(dataset / VIDEO, (picture(index) for index in range(60)), 2 * FPS)
    numbers = [number(f) for t in read_dataset(dataset).trajectories for f in t.frames]
    assert numbers == list(range(0, 60, 2))


def test_write_video(tmp_path: Path):
    frames = np.stack([picture(index) for index in range(5)])
    write_video(tmp_path / "video.mp4", frames, 12.5)
    assert codec_of(tmp_path / "video.mp4") == "h264"
    with av.open(str(tmp_path / "video.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.height, stream.width) == (SIZE, SIZE)
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.average_rate == 12.5
    assert [number(frame) for _, frame in decode(tmp_path / "video.mp4")] == [0, 1, 2, 3, 4]
    assert [path.name for path in tmp_path.iterdir()] == ["video.mp4"]


def test_a_wide_picture_is_shown_whole_or_the_square_that_a_camera_of_its_height_films(
    tmp_path: Path,
):
    frames = np.full((4, SIZE, 2 * SIZE, 3), 40, np.uint8)
    frames[:, :, SIZE // 2 : SIZE // 2 + SIZE] = picture(77)  # the middle
    write(tmp_path / "wide", [Trajectory(frames, np.zeros((3, 2), np.float32), 1 / FPS)])
    whole = read_dataset(tmp_path / "wide", image_size=SIZE // 2).trajectories[0].frames
    assert whole.shape[1:3] == (SIZE // 2, SIZE)
    square = [Footage(is_square=True)]
    recording = read_dataset(tmp_path / "wide", image_size=SIZE, cameras=square)
    middle = recording.trajectories[0].frames
    assert middle.shape[1:3] == (SIZE, SIZE)
    assert number(middle[0]) == 77
    assert np.abs(middle[0].astype(int) - picture(77)).mean() < 4

    upright = Trajectory(frames.transpose(0, 2, 1, 3).copy(), np.zeros((3, 2), np.float32), 1 / FPS)
    write(tmp_path / "upright", [upright])
    whole = read_dataset(tmp_path / "upright", image_size=SIZE).trajectories[0].frames
    assert whole.shape[1:3] == (SIZE, SIZE // 2)
    with pytest.raises(InputError, match="upright"):
        read_dataset(tmp_path / "upright", image_size=SIZE, cameras=square)


@pytest.mark.skipif(not hasattr(Interpolation, "ACCURATE_RND"), reason="PyAV before 18 rounds down")
def test_colours_are_not_darkened(tmp_path: Path):
    frame = resize(np.random.default_rng(0).integers(0, 256, (8, 8, 3), dtype=np.uint8), (64, 64))
    write_video(tmp_path / "video.mp4", [frame], 10, crf=0)
    ((_, decoded),) = decode(tmp_path / "video.mp4")
    assert np.abs((decoded.astype(float) - frame).mean((0, 1))).max() < 0.5


@pytest.mark.parametrize("matrix", ["ITU601", "ITU709"])
def test_colours_are_those_of_the_matrix_that_a_video_names(tmp_path: Path, matrix: str):
    """PyAV before 17 takes all for BT.601's, which is why it is not enough."""
    path, colour = tmp_path / "video.mp4", np.array([200, 30, 30], np.uint8)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10, options={"crf": "0"})
        stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "yuv420p"
        stream.codec_context.colorspace = {"ITU601": 6, "ITU709": 1}[matrix]  # as H.273 counts
        frame = av.VideoFrame.from_ndarray(np.full((SIZE, SIZE, 3), colour), format="rgb24")
        frame = frame.reformat(format="yuv420p", dst_colorspace=matrix)
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    ((_, decoded),) = decode(path)
    assert np.abs(decoded.astype(int) - colour).max() <= 3


def test_odd_sides_are_padded(tmp_path: Path):
    write_video(tmp_path / "video.mp4", np.full((3, 15, 21, 3), 90, np.uint8), 10)
    ((_, frame), *_) = decode(tmp_path / "video.mp4")
    assert frame.shape == (16, 22, 3)
    assert np.abs(frame.astype(int) - 90).max() < 4


def test_write_video_messages(tmp_path: Path):
    with pytest.raises(ValueError, match="at least one frame"):
        write_video(tmp_path / "video.mp4", [], 10)
    with pytest.raises(ValueError, match=r"must be uint8 \(H, W, 3\), got float64 \(4, 4, 3\)"):
        write_video(tmp_path / "video.mp4", np.zeros((1, 4, 4, 3)), 10)
    with pytest.raises(ValueError, match="fps must be a positive number, got 0"):
        write_video(tmp_path / "video.mp4", [picture(0)], 0)
    assert list(tmp_path.iterdir()) == []


# --- resizing -------------------------------------------------------------------------------


def test_resize_is_the_block_mean():
    frame = np.random.default_rng(0).integers(0, 256, (128, 128, 3), dtype=np.uint8)
    mean = frame.reshape(64, 2, 64, 2, 3).mean((1, 3))
    assert np.abs(resize(frame, (64, 64)) - mean).max() <= 0.5
    mean = frame.reshape(32, 4, 16, 8, 3).mean((1, 3))
    assert np.abs(resize(frame, (32, 16)) - mean).max() <= 0.5 + 1e-4


def test_resize_at_odd_factors():
    rng = np.random.default_rng(0)
    frame = rng.integers(0, 256, (30, 45, 3), dtype=np.uint8)
    # 30×45 to 20×30 is 60×90 to 20×30, that is the 3×3 mean of the doubled picture.
    mean = frame.repeat(2, 0).repeat(2, 1).reshape(20, 3, 30, 3, 3).mean((1, 3))
    assert np.abs(resize(frame, (20, 30)) - mean).max() <= 0.5 + 1e-4
    flat = np.full((37, 53, 3), 200, np.uint8)
    for size in ((7, 11), (36, 52), (64, 64), (1, 1)):
        np.testing.assert_array_equal(resize(flat, size), np.full((*size, 3), 200))
    np.testing.assert_array_equal(resize(frame, (60, 90)), frame.repeat(2, 0).repeat(2, 1))


def test_read_resized(written: Path):
    full, small = read_dataset(written), read_dataset(written, image_size=16)
    assert small.facts["cameras"][0]["image_size"] == [16, 16]
    for big, little in zip(full.trajectories, small.trajectories, strict=True):
        mean = big.frames.reshape(-1, 16, 2, 16, 2, 3).mean((2, 4))
        assert np.abs(little.frames - mean).max() <= 1


# --- what is wrong with a dataset -------------------------------------------------------------


def message(folder: Path, **options: object) -> str:
    """The one line that reading the folder gives, less the folder's name."""
    with pytest.raises(InputError) as caught:
        read_dataset(folder, **options)  # type: ignore
    assert caught.value.__suppress_context__ or caught.value.__context__ is None
    text = str(caught.value)
    assert "\n" not in text
    assert str(folder) in text
    return text.replace(str(folder), "HERE")


def test_no_dataset(tmp_path: Path):
    looked_for = (
        "HERE: no recordings; looked for meta/info.json (LeRobotDataset), *.hdf5 (robomimic), "
        "*.npz and pairs of NAME.mp4 and NAME.csv, see docs/recordings.md; "
    )
    assert message(tmp_path / "none") == "HERE: no such folder; expected a folder of recordings"
    assert message(tmp_path) == looked_for + "it is empty"
    (tmp_path / "notes.txt").touch()
    assert message(tmp_path) == looked_for + "it holds: notes.txt"
    assert message(tmp_path / "notes.txt") == "HERE: is a file; expected a folder of recordings"
    (tmp_path / "film.mp4").touch()
    (tmp_path / "other.csv").touch()
    assert message(tmp_path) == (
        "HERE: film.mp4 has no film.csv beside it; expected pairs of a video and its actions, "
        "see docs/recordings.md"
    )


@pytest.mark.parametrize("version", ["v1.6", "v2.2", "v3.1/../x", "3", 3.0, None])
def test_version(dataset: Path, version: object):
    edit_info(dataset, codebase_version=version)
    assert message(dataset) == (
        "HERE/meta/info.json: expected codebase_version v3.0, v2.1 or v2.0, "
        f"got {version!r}; convert the dataset with lerobot"
    )


@pytest.mark.parametrize("fps", [None, 0, -3, "10", True, float("nan"), 1e9])
def test_fps(dataset: Path, fps: object):
    edit_info(dataset, fps=fps)
    expected = f"HERE/meta/info.json: expected fps as a number from 0.01 to 1000, got {fps!r}"
    assert message(dataset) == expected


def test_info_unreadable(dataset: Path):
    (dataset / INFO).write_text("{")
    assert message(dataset).startswith("HERE/meta/info.json: not readable as JSON (")
    (dataset / INFO).write_text("[]")
    assert message(dataset) == "HERE/meta/info.json: expected a JSON object, got list"


def test_info_odd(dataset: Path):
    edit_info(dataset, data_path="data/{episode}.parquet")
    assert "expected a data_path like 'data/chunk-" in message(dataset)
    edit_info(dataset, features=None)
    assert message(dataset) == "HERE/meta/info.json: expected an object 'features', got None"


def test_missing_meta(dataset: Path):
    shutil.rmtree(dataset / "meta/episodes")
    assert message(dataset) == (
        "HERE: meta/episodes/ holds no parquet file; expected "
        "meta/episodes/chunk-000/file-000.parquet, copy the dataset again"
    )


def test_no_action(dataset: Path):
    features = json.loads((dataset / INFO).read_text())["features"]
    del features["action"]
    edit_info(dataset, features=features)
    assert message(dataset) == (
        "HERE: no column 'action', and without actions nothing can be replayed; there are: "
        "observation.images.camera0, timestamp, frame_index, episode_index, index, task_index"
    )


def test_no_action_column(dataset: Path):
    edit_table(
        dataset / DATA, lambda rows: [{k: row[k] for k in row if k != "action"} for row in rows]
    )
    assert message(dataset) == (
        f"HERE/{DATA}: no column 'action'; there are: "
        "timestamp, frame_index, episode_index, index, task_index"
    )


def test_action_size(dataset: Path):
    assert message(dataset, num_actions=6) == (
        "HERE: the task takes 6 actions, the recording has 2 (joint_0, joint_1); "
        "is it of another robot?"
    )
    edit_features(dataset, action={"dtype": "float32", "shape": [3]})
    assert message(dataset) == (
        "HERE: episode 0, row 0: expected 3 actions as meta/info.json says, got 2"
    )
    edit_features(dataset, action={"dtype": "float32", "shape": []})
    assert message(dataset) == (
        "HERE/meta/info.json: expected a shape [A] of 'action' with A from 1 to 1000, got []"
    )


@pytest.mark.parametrize("value", [float("nan"), float("inf"), None])
def test_action_not_finite(dataset: Path, value: float | None):
    def spoil(rows: list[dict]) -> list[dict]:
        rows[12 + 4]["action"] = [0.5, value]
        return rows

    edit_table(dataset / DATA, spoil)
    shown = "inf" if value == float("inf") else "nan"
    assert message(dataset) == (
        f"HERE: episode 1, row 4: action is not finite: [0.5, {shown}]; drop or repair the episode"
    )


def test_action_not_a_number(dataset: Path):
    edit_table(dataset / DATA, lambda rows: [row | {"action": ["left", "right"]} for row in rows])
    assert message(dataset) == f"HERE/{DATA}: expected numbers in column 'action'"


def test_rows_missing(dataset: Path):
    edit_table(dataset / DATA, lambda rows: rows[:-2])
    assert message(dataset) == (
        f"HERE/{DATA}: expected 10 rows of episode 2, got 8; copy the dataset again"
    )


def test_rows_doubled(dataset: Path):
    edit_table(dataset / DATA, lambda rows: [*rows[:3], rows[2], *rows[4:]])
    assert message(dataset) == (
        "HERE: episode 0: expected frame_index 3, got 2; rows are missing or doubled"
    )


def test_timestamps_of_another_rate(dataset: Path):
    edit_info(dataset, fps=20)
    assert message(dataset) == (
        "HERE: episode 0, row 1: expected timestamp 0.05 s at 20 frames/s, got 0.1 s; "
        "is fps in meta/info.json right?"
    )


@pytest.mark.parametrize(("later_s", "lasts_s"), [(1.2, 0.8), (1e9, 0.8)])
def test_timestamps_that_are_not_of_an_episodes_own_part_of_a_video(
    dataset: Path, later_s: float, lasts_s: float
):
    """Of the whole file, or of the day: frames of the next episode would be shown."""
    edit_table(
        dataset / DATA,
        lambda rows: [
            row | {"timestamp": row["timestamp"] + later_s * (row["episode_index"] == 1)}
            for row in rows
        ],
    )
    text = message(dataset)
    assert text.startswith("HERE: episode 1: timestamps from 1")
    assert f"expected seconds since its first frame, of {lasts_s:g} s of video" in text


def test_short_episode(dataset: Path):
    edit_table(dataset / EPISODES, lambda rows: [rows[0], rows[1] | {"length": 1}, rows[2]])
    assert message(dataset) == (
        "HERE: episode 1 has 1 row; expected at least 2, a frame before and a frame after an "
        "action; leave it out (--leave-out 1)"
    )
    assert len(read_dataset(dataset, max_episodes=1).trajectories) == 1  # the others are sound


def test_episodes_odd(dataset: Path):
    edit_table(dataset / EPISODES, lambda rows: [rows[0], rows[0]])
    assert message(dataset) == f"HERE/{EPISODES}: episode 0 is listed twice"
    edit_table(dataset / EPISODES, lambda rows: [rows[0], rows[1] | {"data/file_index": None}])
    assert message(dataset) == (
        f"HERE/{EPISODES}: episode 0: expected a number in 'data/file_index', got None"
    )


def test_episodes_missing(dataset: Path):
    edit_table(dataset / EPISODES, lambda rows: rows[:2])
    assert message(dataset) == (
        "HERE: expected 3 episodes as meta/info.json says, meta/episodes/ lists 2; "
        "copy the dataset again"
    )


def test_no_episodes(dataset: Path):
    path = dataset / EPISODES
    pq.write_table(pq.read_table(path).slice(0, 0), path)
    assert message(dataset) == "HERE: holds no episode; expected at least one"


def test_camera_names(dataset: Path):
    assert message(dataset, cameras=[Footage(key="front")]) == (
        "HERE: no camera 'front'; there are: observation.images.camera0"
    )
    features = json.loads((dataset / INFO).read_text())["features"]
    camera = features.pop("observation.images.camera0")
    edit_info(dataset, features=features)
    assert message(dataset).startswith(
        "HERE: no camera, that is no feature of dtype 'video' or 'image'; "
    )
    edit_features(dataset, camera=camera | {"dtype": "image"})
    assert message(dataset).startswith(f"episode 0, step 0: HERE/{DATA}: no column 'camera'; ")


@pytest.mark.parametrize("file", [DATA, EPISODES])
def test_parquet_unreadable(dataset: Path, file: str):
    content = (dataset / file).read_bytes()
    (dataset / file).write_bytes(content[: len(content) // 2])
    assert message(dataset).startswith(f"HERE/{file}: not a readable parquet file (")
    (dataset / file).write_bytes(content[:50] + bytes(200) + content[250:])
    assert message(dataset).startswith(f"HERE/{file}: not a readable parquet file (")


def test_files_missing(dataset: Path):
    (dataset / VIDEO).unlink()
    assert message(dataset) == f"episode 0, step 0: HERE/{VIDEO}: no such video"
    (dataset / DATA).unlink()
    assert message(dataset) == f"HERE/{DATA}: missing, though the dataset's meta files name it"


def test_video_short(dataset: Path):
    write_video(dataset / VIDEO, [picture(index) for index in range(17)], FPS)
    assert message(dataset) == (
        f"episode 1, step 5: HERE/{VIDEO}: ends at 1.6 s, and a row asks for the frame at "
        "1.7 s: there are fewer frames than rows; copy the file again, or leave the episode out "
        "(--leave-out)"
    )
    assert len(read_dataset(dataset, max_episodes=1).trajectories) == 1


@pytest.mark.parametrize("lost", [1, 2])
def test_rows_after_a_videos_end_go_without(dataset: Path, lost: int):
    """Of the last episode, and of one that another follows in the file at once."""
    last = sum(NUM_STEPS) + len(NUM_STEPS) - lost
    write_video(dataset / VIDEO, [picture(index) for index in range(last)], FPS)
    sound, recording = make_trajectories(), read_dataset(dataset)
    assert recording.facts["unfilmed"] == {"episode 2": lost}
    assert len(recording.trajectories[1]) == NUM_STEPS[1]
    found = recording.trajectories[2]
    np.testing.assert_array_equal(found.actions, sound[2].actions[:-lost])
    assert [number(frame) for frame in found.frames] == list(range(20, last))


@pytest.mark.parametrize("lost", [1, 2])
def test_rows_after_an_episodes_end_within_a_video_go_without(dataset: Path, lost: int):
    """As lerobot converts v2: the next episode begins where the short video ended."""
    end = NUM_STEPS[0] + 1
    shown = [*range(end - lost), *range(end, sum(NUM_STEPS) + len(NUM_STEPS))]
    write_video(dataset / VIDEO, [picture(index) for index in shown], FPS)
    key = "videos/observation.images.camera0/from_timestamp"
    edit_table(
        dataset / EPISODES,
        lambda rows: [rows[0], *(row | {key: row[key] - lost / FPS} for row in rows[1:])],
    )
    sound, recording = make_trajectories(), read_dataset(dataset)
    assert recording.facts["unfilmed"] == {"episode 0": lost}
    for episode, num_lost in enumerate((lost, 0, 0)):
        found, whole = recording.trajectories[episode], sound[episode]
        np.testing.assert_array_equal(found.actions, whole.actions[: len(whole) - num_lost])
        first = number(whole.frames[0])
        assert [number(frame) for frame in found.frames] == list(
            range(first, first + len(found) + 1)
        )


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.98])
def test_video_truncated(dataset: Path, share: float):
    content = (dataset / VIDEO).read_bytes()
    (dataset / VIDEO).write_bytes(content[: int(len(content) * share)])
    assert "copy the file again" in message(dataset)


def test_video_garbage(dataset: Path):
    content = (dataset / VIDEO).read_bytes()
    (dataset / VIDEO).write_bytes(b"not a video" * 100)
    assert message(dataset) == (
        f"episode 0, step 0: HERE/{VIDEO}: not a readable video (Invalid data found when "
        "processing input); it may be truncated, copy the file again"
    )
    middle = len(content) * 2 // 3
    noise = np.random.default_rng(0).bytes(2000)
    (dataset / VIDEO).write_bytes(content[:middle] + noise + content[middle + 2000 :])
    text = message(dataset)
    assert text.startswith("episode ")
    assert "copy the file again" in text


def test_timestamps_overlap(dataset: Path):
    key = "videos/observation.images.camera0/from_timestamp"
    edit_table(dataset / EPISODES, lambda rows: [rows[0], rows[1] | {key: 0.3}, rows[2]])
    assert message(dataset) == (
        f"HERE/{VIDEO}: episode 1 starts at 0.3 s, before episode 0 ends; "
        "the timestamps in meta/episodes are wrong, or the 10 fps of meta/info.json"
    )


def test_image_size(written: Path):
    with pytest.raises(InputError, match="image_size must be at least 1"):
        read_dataset(written, image_size=0)


# --- the recorded real world ------------------------------------------------------------------


def test_recorded_real(written: Path):
    real = RecordedReal(open_dataset(written, image_size=16, num_actions=2))
    as_protocol: RealWorld = real
    assert as_protocol.step_s == pytest.approx(0.1)
    assert real.facts == {}
    first = real.collect(1)
    assert [len(trajectory) for trajectory in first] == [11]
    assert [len(trajectory) for trajectory in real.collect(2)] == [11, 7]
    assert (real.facts["episodes"], real.facts["steps"]) == (2, 18)
    assert [len(trajectory) for trajectory in real.collect()] == [11, 7, 9]
    np.testing.assert_array_equal(real.collect(1)[0].frames, first[0].frames)
    assert first[0].frames.shape == (12, 16, 16, 3)
    assert real.facts["episodes"] == 3
    for num_episodes in (0, 4):
        with pytest.raises(InputError, match=f": {num_episodes} episodes asked for, it holds 3; "):
            real.collect(num_episodes)
