"""Recordings that are damaged or hostile: one line, status 2, nothing written, little memory."""

import csv
import io
import json
import multiprocessing
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import av
import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from lerobot_v21 import DATA as DATA_V21
from lerobot_v21 import EPISODES as LINES
from lerobot_v21 import VIDEO as VIDEO_V21
from lerobot_v21 import write_v21
from servo_arm import TUNE, write_arm

import simtune.tuning_run  # noqa: F401  so that no command has to load it
from simtune import cli
from simtune.checking import check
from simtune.config import CheckConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.experiment import build_experiment
from simtune.recordings import open_dataset, write_dataset, write_video
from simtune.tasks import TASKS, Task, load_task
from simtune.trajectory import Trajectory

NUM_STEPS, FPS, SIZE = 24, 12.5, 32
VIDEO = "videos/observation.images.camera0/chunk-000/file-000.mp4"
DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
INFO = "meta/info.json"
HDF5 = "demo.hdf5"
DATA_1, VIDEO_1 = (name.format(chunk=0, episode=1) for name in (DATA_V21, VIDEO_V21))
MOST_MB = 150  # of growth; all of them need 25, and huge ones would need gigabytes


# --- sound ones, to spoil -----------------------------------------------------------------


def trajectories() -> list[Trajectory]:
    rng = np.random.default_rng(0)
    frames = rng.integers(256, size=(2, NUM_STEPS + 1, 8, 8, 3)).repeat(4, 2).repeat(4, 3)
    actions = rng.uniform(-1, 1, (2, NUM_STEPS, 1)).astype(np.float32)
    return [
        Trajectory(f.astype(np.uint8), a, 1 / FPS) for f, a in zip(frames, actions, strict=True)
    ]


def write_lerobot(folder: Path) -> None:
    names = ["slide"]
    write_dataset(folder, trajectories(), action_names=names, robot_type="arm", task="balance")


def write_lines(folder: Path) -> None:
    """A LeRobotDataset v2.1, with readings."""
    episodes = [
        {
            "action": np.concatenate([trajectory.actions, [[0.0]]]),
            "observation.state": np.zeros((NUM_STEPS + 1, 2)),
            "frames": trajectory.frames,
        }
        for trajectory in trajectories()
    ]
    write_v21(folder, episodes, {"action": ["slide"], "observation.state": ["x", "v"]}, fps=FPS)


def write_pairs(folder: Path) -> None:
    folder.mkdir()
    for i, trajectory in enumerate(trajectories()):
        write_video(folder / f"swing{i}.mp4", trajectory.frames, FPS)
        write_table(folder, i, ["slide"], trajectory.actions.tolist())


def write_table(folder: Path, episode: int, header: list[str], rows: list[list]) -> None:
    with (folder / f"swing{episode}.csv").open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])


def write_hdf5(folder: Path) -> None:
    folder.mkdir()
    with h5py.File(folder / HDF5, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": FPS}})
        for i, trajectory in enumerate(trajectories()):
            data[f"demo_{i}/actions"] = np.concatenate([trajectory.actions, [[0.0]]])
            data[f"demo_{i}/obs/agentview_image"] = trajectory.frames
            data[f"demo_{i}/obs/joints"] = np.zeros((NUM_STEPS + 1, 2))


SOUND = {"lerobot": write_lerobot, "v21": write_lines, "pairs": write_pairs, "hdf5": write_hdf5}


# --- ways to spoil them -------------------------------------------------------------------


def cut(name: str, share: float) -> Callable[[Path], None]:
    """Leave so much of a file."""

    def spoil(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: int(len(content) * share)])

    return spoil


def flipped(name: str, place: bytes) -> Callable[[Path], None]:
    """Flip a bit where a file has these bytes first, so that they are no UTF-8 any more."""

    def spoil(folder: Path) -> None:
        content = bytearray((folder / name).read_bytes())
        content[content.index(place)] ^= 0x80
        (folder / name).write_bytes(content)

    return spoil


def info(**changes: object) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        content = json.loads((folder / INFO).read_text())
        (folder / INFO).write_text(json.dumps(content | changes))

    return spoil


def feature(name: str, **changes: object) -> Callable[[Path], None]:
    """Change a feature in meta/info.json."""

    def spoil(folder: Path) -> None:
        features = json.loads((folder / INFO).read_text())["features"]
        info(features=features | {name: features.get(name, {}) | changes})(folder)

    return spoil


def gone(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def text(name: str, content: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_text(content) and None


def rows(name: str, edit: Callable[[list[dict]], list[dict]]) -> Callable[[Path], None]:
    """Change a parquet file's rows."""

    def spoil(folder: Path) -> None:
        table = pa.Table.from_pylist(edit(pq.read_table(folder / name).to_pylist()))
        pq.write_table(table, folder / name)

    return spoil


def huge_table(folder: Path) -> None:
    """A few kB that are 40 million rows."""
    table = pq.read_table(folder / DATA)
    million = table.take(np.zeros(1_000_000, int))
    with pq.ParquetWriter(folder / DATA, table.schema) as writer:
        for _ in range(40):
            writer.write_table(million)


def huge_pictures(folder: Path) -> None:
    with av.open(str(folder / VIDEO), "w") as container:
        stream = container.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 9000, 5000, "yuvj420p"
        container.mux(stream.encode(av.VideoFrame(9000, 5000, "yuvj420p")))
        container.mux(stream.encode(None))


def hostile_camera(folder: Path) -> None:
    """A camera whose name leads out."""
    key = "observation.images.camera0"
    name = json.loads((folder / INFO).read_text())["features"]
    name["../../../x"] = name.pop(key)
    info(features=name)(folder)
    rows(EPISODES, lambda rs: [{k.replace(key, "../../../x"): r[k] for k in r} for r in rs])(folder)


def swapped(data: list[dict]) -> list[dict]:
    return [row | {"episode_index": 1 - row["episode_index"]} for row in data]


def table(*lines: str) -> Callable[[Path], None]:
    return text("swing1.csv", "\n".join(lines) + "\n")


def timed(first_s: float, step_s: float) -> Callable[[Path], None]:
    """Rows of the second episode that say when they began."""

    def spoil(folder: Path) -> None:
        for i in range(2):
            times_s = [(first_s if i else 0) + (step_s if i else 0.08) * t for t in range(24)]
            write_table(folder, i, ["time", "slide"], [[time_s, 0.1] for time_s in times_s])

    return spoil


def hdf5(edit: Callable[[h5py.Group, Path], object]) -> Callable[[Path], None]:
    """Change /data, given the folder too."""

    def spoil(folder: Path) -> None:
        with h5py.File(folder / HDF5, "r+") as file:
            edit(file["data"], folder)

    return spoil


def replaced(demo: str, key: str, **options: object) -> Callable[[Path], None]:
    def edit(data: h5py.Group, _: Path) -> None:
        del data[demo][key]
        data[demo].create_dataset(key, **options)

    return hdf5(edit)


def linked(data: h5py.Group, folder: Path) -> None:
    with h5py.File(folder.parent / "elsewhere.h5", "w") as file:
        file["actions"] = np.zeros((25, 1))
    del data["demo_1/actions"]
    data["demo_1/actions"] = h5py.ExternalLink("../elsewhere.h5", "/actions")


def borrow(group: h5py.Group, name: str, shape: tuple[int, ...]) -> None:
    """Its bytes are those of another file."""
    del group[name]
    source = [("/etc/passwd", 0, 8 * int(np.prod(shape)))]
    group.create_dataset(name, shape, "f8", external=source)


@dataclass(frozen=True)
class Case:
    kind: str
    spoil: Callable[[Path], object]
    message: str  # a regular expression


def lerobot(spoil: Callable[[Path], object], message: str) -> Case:
    return Case("lerobot", spoil, message)


def lines(spoil: Callable[[Path], object], message: str) -> Case:
    return Case("v21", spoil, message)


def pairs(spoil: Callable[[Path], object], message: str) -> Case:
    return Case("pairs", spoil, message)


def demos(spoil: Callable[[Path], object], message: str) -> Case:
    return Case("hdf5", spoil, message)


def listed(*lengths: int, indexes: Sequence[int] = (0, 1)) -> Callable[[Path], None]:
    rows = zip(indexes, lengths, strict=True)
    return text(LINES, "\n".join(f'{{"episode_index": {i}, "length": {n}}}' for i, n in rows))


def set_rows(**changes: object) -> Callable[[list[dict]], list[dict]]:
    return lambda found: [row | changes for row in found]


CASES = {
    "truncated video": lerobot(cut(VIDEO, 0.6), "episode [01].*copy the file again"),
    "wrong fps": lerobot(info(fps=30), "episode 0, row 1: .*is fps in meta/info.json right"),
    "huge fps": lerobot(info(fps=1e300), r"fps as a number from 0.01 to 1000, got 1e\+300"),
    "no column": lerobot(
        rows(DATA, lambda found: [{k: r[k] for k in r if k != "timestamp"} for r in found]),
        "no column 'timestamp'; there are: action",
    ),
    "another version": lines(
        info(codebase_version="v1.6"), "codebase_version v3.0, v2.1 or v2.0, got 'v1.6'; convert"
    ),
    "version of a number": lines(info(codebase_version=2), "codebase_version v3.0, .*, got 2"),
    "no frames a second": lines(info(fps=None), "fps as a number from 0.01 to 1000, got None"),
    "features of a list": lines(info(features=[1]), r"expected an object 'features', got \[1\]"),
    "a number of text": lines(info(total_episodes="2"), "expected '2' episodes as meta/info.json"),
    "a folder for lines": lines(
        lambda folder: (gone(LINES)(folder), (folder / LINES).mkdir()), "cannot be read .Is a dir"
    ),
    "empty rows": lines(
        lambda folder: (folder / DATA_1).write_bytes(b""), "not a readable parquet file .*again"
    ),
    "an action beyond float32": pairs(
        table("slide", *["0.1"] * 23, "1e300"), r"swing1.*: action is not finite: \[1e\+300\]"
    ),
    "NaN": lerobot(
        rows(DATA, set_rows(action=float("nan"))), "episode 0, row 0: action is not finite"
    ),
    "shuffled episodes": lerobot(rows(DATA, swapped), "index 0 .*got 25; episodes are mixed up"),
    "huge integers": lerobot(rows(DATA, set_rows(frame_index=2**62)), "expected frame_index 0"),
    "columns of columns": lerobot(
        rows(DATA, set_rows(timestamp={"s": 0.1})), "expected numbers in column 'timestamp'"
    ),
    "long path": lerobot(info(data_path="x" * 300), "leads out of the dataset"),
    "no episode": lerobot(
        lambda folder: pq.write_table(
            pq.read_table(folder / EPISODES).slice(0, 0), folder / EPISODES
        ),
        "holds no episode",
    ),
    "huge pictures": lerobot(huge_pictures, "9000×5000 pixels; expected at most 7680×4320"),
    "huge number of rows": lerobot(huge_table, "has 40000000 values in column"),
    "huge claimed length": lerobot(
        rows(EPISODES, set_rows(length=10**12)),
        "episode 0 has 1000000000000 rows; expected at most",
    ),
    "huge claimed episodes": lerobot(
        info(total_episodes=10**12), "expected 1000000000000 episodes"
    ),
    "huge claimed action": lerobot(feature("action", shape=[10**9]), "with A from 1 to 1000, got"),
    "data elsewhere": lerobot(
        info(data_path="../secret/{chunk_index}"), "leads out of the dataset"
    ),
    "video elsewhere": lerobot(info(video_path="/etc/passwd"), "leads out of the dataset"),
    "camera elsewhere": lerobot(hostile_camera, "leads out of the dataset"),
    "wide template": lerobot(info(data_path="{chunk_index:09999999999d}"), "expected a data_path"),
    "sly template": lerobot(info(data_path="{chunk_index.real}"), "expected a data_path like"),
    "half a JSON": lerobot(cut(INFO, 0.5), "not readable as JSON"),
    "deep JSON": lerobot(text(INFO, "[" * 100_000), "not readable as JSON"),
    "long number": lerobot(text(INFO, '{"fps": 1' + "0" * 10_000 + "}"), "not readable as JSON"),
    "huge JSON": lerobot(
        lambda folder: (folder / INFO).open("r+b").truncate(10**10),
        "expected a few kB, got 10000 MB",
    ),
    "a flipped byte of a name": lerobot(
        flipped(DATA, b"action"), "file-000.parquet: not a readable parquet file .*copy the file"
    ),
    "a flipped byte of a list's name": lerobot(
        flipped(EPISODES, b"episode_index"), "not a readable parquet file .*copy the file again"
    ),
    "a flipped byte of an episode": lines(
        flipped(DATA_1, b"timestamp"), "episode_000001.parquet: not a readable parquet file"
    ),
    "no lines": lines(gone(LINES), "meta/episodes.jsonl: missing; copy the dataset again"),
    "half a line": lines(cut(LINES, 0.7), "episodes.jsonl: line 2: not readable as JSON"),
    "lines of bytes": lines(
        lambda folder: (folder / LINES).write_bytes(b"\xff\xfe\0"), "jsonl: not readable as JSON"
    ),
    "deep lines": lines(text(LINES, "[" * 100_000), "line 1: not readable as JSON"),
    "huge lines": lines(
        lambda folder: (folder / LINES).open("r+b").truncate(10**10), "a few kB, got 10000 MB"
    ),
    "no line": lines(text(LINES, "\n"), "holds no episode"),
    "a line doubled": lines(listed(25, 25, indexes=(0, 0)), "line 2: episode 0 is listed twice"),
    "a line without length": lines(
        text(LINES, '{"episode_index": 0}'), "line 1: expected a number in 'length', got None"
    ),
    "an infinite line": lines(
        text(LINES, '{"episode_index": Infinity, "length": 9}'), "a number in 'episode_index'"
    ),
    "too short a line": lines(listed(25, 24), "expected 24 rows of episode 1, got 25; copy"),
    "too long a line": lines(listed(25, 10**9), "episode 1 has 1000000000 rows; expected at most"),
    "a line too few": lines(listed(25, indexes=(0,)), "expected 2 episodes .*jsonl lists 1"),
    "no rows of an episode": lines(gone(DATA_1), "episode_000001.parquet: missing, though"),
    "no video of an episode": lines(gone(VIDEO_1), "episode 1, step 0: .*: no such video"),
    "half a video": lines(cut(VIDEO_1, 0.6), "episode 1.*copy the file again"),
    "rows elsewhere": lines(
        info(data_path="../secret/{episode_index}"), "leads out of the dataset"
    ),
    "film elsewhere": lines(info(video_path="/etc/{episode_index:06d}"), "leads out of the data"),
    "chunks elsewhere": lines(
        info(data_path="{episode_chunk}/../../{episode_index}"), "leads out of the dataset"
    ),
    "a sly chunk": lines(
        info(data_path="{episode_chunk.real}/{episode_index}"), "expected a data_path like"
    ),
    "one file for all": lines(info(video_path="video.mp4"), "expected a video_path like"),
    "chunks of none": lines(info(chunks_size=0), "expected a whole chunks_size of at least 1"),
    "deep names": lines(
        feature("action", names=json.loads("[" * 500 + "]" * 500), shape=[2]),
        r"takes 1 actions, the recording has 2 \(action_0, action_1\)",
    ),
    "no partner": pairs(
        lambda folder: (folder / "swing1.csv").unlink(), "swing1.mp4 has no swing1.csv"
    ),
    "too many rows": pairs(
        table("slide", *["0.1"] * 40), "40 rows, swing1.mp4 has 25 frames; expected a row a frame"
    ),
    "ragged row": pairs(
        table("slide", "0.1", "0.1,0.2"), r"line 3 of \S+/swing1.csv: expected 1 cells, got 2"
    ),
    "a gap": pairs(
        table("slide", *["0.1"] * 8, "", *["0.1"] * 16),
        r"swing1.csv: line 10 is empty, but others follow",
    ),
    "a word": pairs(table("slide", "0.1", "left"), "line 3 of .*: expected a number, got 'left'"),
    "a NaN": pairs(
        table("slide", *["0.1"] * 23, "nan"), r"line 25 of \S+/swing1.csv: action is not finite"
    ),
    "no header": pairs(table("0.1", "0.2"), "expected a header with the actions' names, got 0.1"),
    "an index of pandas": pairs(table(",slide", "0,0.1"), "column 1 has no name; .* pandas"),
    "another header": pairs(table("cart", "0.2"), r"columns of swing0.csv \(slide\), got cart"),
    "nothing": pairs(text("swing1.csv", ""), "swing1.csv: is empty"),
    "no text": pairs(lambda folder: (folder / "swing1.csv").write_bytes(b"\xff\xfe\0"), "as CSV"),
    "one endless line": pairs(text("swing1.csv", "slide\n" + "1" * 10**6), "not readable as CSV"),
    "time runs back": pairs(timed(0.5, -0.01), "line 3 of .*: expected rising seconds"),
    "another clock": pairs(
        timed(1.7e9, 0.08),
        "until 1700000002 s, swing1.mp4 ends at 1.92 s; .*in seconds, and counted from there",
    ),
    "milliseconds": pairs(timed(0.0, 80.0), "swing1.mp4 ends at 1.92 s; .* are its times in sec"),
    "another rate": pairs(timed(0.0, 0.05), "swing1 has 20 actions/s, the first episode 12.5"),
    "a truncated video": pairs(cut("swing1.mp4", 0.6), "has 13 frames; .*is the video whole"),
    "no actions": demos(hdf5(lambda data, _: data.pop("demo_1/actions")), "demo_1 has no actions"),
    "no demos": demos(
        hdf5(lambda data, _: [data.pop(name) for name in list(data)]), "holds no episode"
    ),
    "no rate": demos(
        hdf5(lambda data, _: data.attrs.pop("env_args")), "give the rate as --control-hz"
    ),
    "truncated file": demos(cut(HDF5, 0.5), "not readable as HDF5 .*copy the file again"),
    "floats": demos(
        replaced("demo_1", "obs/agentview_image", shape=(25, 8, 8, 3), dtype="f4"),
        r"demo_1: expected obs/agentview_image as \(T, H, W, 3\) uint8",
    ),
    "fewer pictures": demos(
        replaced("demo_1", "obs/agentview_image", shape=(9, 8, 8, 3), dtype="u1"),
        "demo_1 has 25 actions and 9 pictures",
    ),
    "huge claimed actions": demos(
        replaced("demo_1", "actions", shape=(10**12, 1), dtype="f8", chunks=(1000, 1)),
        r"demo_1: expected actions \(T, A\) with T up to 100000 .*got \(1000000000000, 1\)",
    ),
    "huge chunk": demos(
        replaced(
            "demo_1",
            "obs/agentview_image",
            shape=(25, 8, 8, 3),
            dtype="u1",
            chunks=(10**7, 8, 8, 3),
            maxshape=(None, 8, 8, 3),
        ),
        "chunks of 1920 MB",
    ),
    "another file": demos(hdf5(linked), "demo_1: actions leads out of the file"),
    "another file's bytes": demos(
        hdf5(lambda data, _: borrow(data["demo_1"], "actions", (25, 1))),
        "demo_1: actions leads out of the file",
    ),
}


def tell(commands: list[tuple[str, tuple[str, ...]]], path: Path) -> None:
    """Run commands, and write what each of them did and took, a line of JSON each."""
    task = load_task("cartpole")  # once, as a model takes longer to compile than recordings to fail
    assert isinstance(task, Task)
    actions, content_hash, model = task.load_actions(), task.content_hash, task.nominal_model
    Task.load_actions, Task.content_hash = lambda self: actions, content_hash  # type: ignore
    Task.nominal_model = model  # type: ignore
    TASKS["cartpole"] = lambda: task
    with path.open("w") as file:
        for name, command in commands:
            said = said_by(command)
            print(json.dumps([name, command[0], said]), file=file, flush=True)


def said_by(command: tuple[str, ...]) -> dict:
    Path("/proc/self/clear_refs").write_text("5")  # the peak so far is forgotten
    out, err, before = io.StringIO(), io.StringIO(), now_mb("VmRSS")
    sys.argv, status = ["simtune", *command], 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            cli.main()
        except SystemExit as exit_:
            status = exit_.code
    took = {"mb": now_mb("VmHWM") - before}
    return {"status": status, "out": out.getvalue(), "err": err.getvalue()} | took


def now_mb(which: str) -> float:
    return int(re.search(which + r":\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) / 1e3


@pytest.fixture(scope="module")
def told(tmp_path_factory) -> dict[tuple[str, str], dict]:
    """What `check` and `tune` say of each case."""
    root = tmp_path_factory.mktemp("unsound")
    for kind, write in SOUND.items():
        write(root / kind)
    commands = []
    for name, case in CASES.items():
        folder = root / name.replace(" ", "_") / "recordings"
        shutil.copytree(root / case.kind, folder)
        case.spoil(folder)
        # A size that is given, but for one: finding one plays the task, which takes longest.
        size = () if name == "truncated video" else ("--image-size", "64")
        real = ("cartpole", "--real", str(folder), *size)
        commands.append((name, ("check", *real)))
        tune = ("--out", str(folder.parent / "out"), "--real-episodes", "2")
        commands.append((name, ("tune", *real, *tune)))
    # In a process of its own, for what they leave in memory, that has done all imports
    process = multiprocessing.get_context("fork").Process(
        target=tell, args=(commands, root / "said")
    )
    process.start()
    process.join()
    lines = [json.loads(line) for line in (root / "said").read_text().splitlines()]
    left = [str(path) for path in root.glob("*/*") if path.name == "out"]
    assert len(lines) == len(commands), process.exitcode
    assert left == []
    return {(name, command): said for name, command, said in lines}


@pytest.mark.thorough
@pytest.mark.parametrize("command", ["check", "tune"])
@pytest.mark.parametrize("name", CASES)
def test_it_is_refused_in_one_line(told, name: str, command: str):
    said = told[name, command]
    lines = [line for line in said["err"].splitlines() if not re.match(r" *\d+ s +\d+ %", line)]
    assert (said["status"], said["out"]) == (2, ""), lines
    assert len(lines) == 1
    assert lines[0].startswith("simtune: ")
    assert re.search(CASES[name].message, lines[0]), lines[0]
    assert len(lines[0]) < 500
    assert said["mb"] < MOST_MB


# --- readings, which commands ask for by a tuning file only --------------------------------


def measured(name: str, *cells: str) -> Callable[[Path], None]:
    """Both tables with one reading more, in the second of which its first cells are these."""

    def spoil(folder: Path) -> None:
        for i in range(2):
            rows = [[0.1, "0.2"] for _ in range(NUM_STEPS)]
            for row, cell in enumerate(cells if i else ()):
                rows[row][1] = cell
            write_table(folder, i, ["slide", name], rows)

    return spoil


def state(value: object) -> Callable[[Path], None]:
    return rows(DATA_1, set_rows(**{"observation.state": value}))


STATE = "observation.state"
OF_KIND = {"v21": (STATE,), "pairs": ("measured.x",), "hdf5": ("joints",)}
READING_CASES = {
    "too few numbers": lines(
        state([0.1]), "episode 1, row 0: expected 2 numbers of 'observation.state' as meta/"
    ),
    "one number for two": lines(state(0.1), "expected 2 numbers of 'observation.state' .* got 1"),
    "never finite": lines(
        state([0.1, float("nan")]),
        "episode 1: reading observation.state.v is missing at every step; leave",
    ),
    "all missing": lines(state(None), "expected 2 numbers|missing at every step"),
    "huge": lines(
        state([1e300, 0.1]), r"episode 1, step 0: reading observation.state.x is 1e\+300; expected"
    ),
    "one that is huge": pairs(
        measured("measured.x", "0", "1e30"), r"swing1, step 1: reading measured.x is 1e\+30; expect"
    ),
    "another shape": lines(
        feature(STATE, shape=[3]), "expected 3 numbers of 'observation.state' as meta/info.json"
    ),
    "no shape": lines(feature(STATE, shape=None), "no reading 'observation.state'"),
    "shape of text": lines(feature(STATE, shape="2"), "no reading 'observation.state'"),
    "shape below 0": lines(feature(STATE, shape=[-2]), "no reading 'observation.state'"),
    "lists of lists": lines(state([[0.1], [0.2]]), "expected numbers in column 'observation.sta"),
    "empty lists": lines(state([]), "row 0: expected 2 numbers of 'observation.state' .* got 0"),
    "text": lines(state("left"), "expected numbers in column 'observation.state'"),
    "lists of text": lines(state(["a", "b"]), "expected numbers in column 'observation.state'"),
    "no such column": lines(
        rows(DATA_1, lambda found: [{k: r[k] for k in r if k != STATE} for r in found]),
        "episode_000001.parquet: no column 'observation.state'; there are: action",
    ),
    "a text feature": lines(
        feature(STATE, dtype="string"), "no reading 'observation.state'; .* have no readings"
    ),
    "a matrix": lines(feature(STATE, shape=[2, 2]), "no reading 'observation.state'"),
    "a huge shape": lines(feature(STATE, shape=[10**9]), "no reading 'observation.state'"),
    "a word": pairs(
        measured("measured.x", "0", "up"), "line 3 of .*swing1.csv: expected a number, got 'up'"
    ),
    "all cells empty": pairs(
        measured("measured.x", *[""] * NUM_STEPS),
        "swing1: reading measured.x is missing at every step",
    ),
    "an action": pairs(measured("x"), "no reading 'measured.x'; the recordings have no readings"),
    "another name": pairs(
        measured("measured.y"), "no reading 'measured.x'; did you mean 'measured.y'. there are: y"
    ),
    "wide": demos(
        replaced("demo_1", "obs/joints", shape=(25, 3), dtype="f4"),
        r"demo_1: expected obs/joints as numbers \(25, 2\), a row an action, got \(25, 3\) float32",
    ),
    "short": demos(
        replaced("demo_1", "obs/joints", shape=(24, 2), dtype="f4"),
        r"expected obs/joints as numbers \(25, 2\), a row an action, got \(24, 2\)",
    ),
    "huge claimed": demos(
        replaced("demo_1", "obs/joints", shape=(10**12, 2), dtype="f8", chunks=(1000, 2)),
        r"expected obs/joints as numbers .* got \(1000000000000, 2\)",
    ),
    "words": demos(
        replaced("demo_1", "obs/joints", data=[[b"a", b"b"]] * 25), r"as numbers .* got \(25, 2\)"
    ),
    "no joints": demos(
        hdf5(lambda data, _: data.pop("demo_1/obs/joints")),
        "demo_1 has no obs/joints; there are: obs/agentview_image$",
    ),
    "joints elsewhere": demos(
        hdf5(lambda data, _: borrow(data["demo_1/obs"], "joints", (25, 2))),
        "demo_1: obs/joints leads out of the file",
    ),
}


@pytest.mark.parametrize("name", READING_CASES)
def test_unsound_readings_are_refused_in_one_line(tmp_path: Path, name: str):
    case = READING_CASES[name]
    SOUND[case.kind](tmp_path / "recordings")
    case.spoil(tmp_path / "recordings")

    def read_all() -> None:
        readings = {"joints": OF_KIND[case.kind]}
        dataset = open_dataset(tmp_path / "recordings", readings=readings, cameras=())
        for episode in range(dataset.num_episodes):
            dataset.read(episode)

    with pytest.raises(InputError, match=case.message) as caught:
        read_all()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


# --- sensors of a tuning file, and recordings that do not suit them -------------------------


JOINTS = ["shoulder", "elbow"]
SENSORS = {
    "an action's name": (["slide"], "no reading 'slide'; there are: x, v"),
    "one for two": (["observation.state.x"], "holds 1 numbers, sensor encoders has 2 joints"),
    "twice": (["x", "x"], "encoders has observation.state.x twice; name it once"),
    "too many numbers": (
        ["observation.state"], "holds 2 numbers, sensor encoders has 1 joints; name a column for"
    ),
}  # fmt: skip


@pytest.mark.parametrize("command", ["check", "tune"])
@pytest.mark.parametrize("name", SENSORS)
def test_sensors_that_do_not_suit_recordings_are_told_in_one_line(
    tmp_path: Path, name: str, command: str
):
    columns, message = SENSORS[name]
    joints = ["shoulder"] if name in ("an action's name", "too many numbers") else JOINTS
    sensor = f"joints = {json.dumps(joints)}\ncolumns = {json.dumps(columns)}"
    tune_file = TUNE.replace('joints = ["shoulder", "elbow"]', sensor)
    arm = write_arm(tmp_path, tune_file + '[actions]\nactuators = ["shoulder"]\n')
    write_lines(tmp_path / "real")
    real = tmp_path / "real"
    with pytest.raises(InputError, match=message) as caught:
        {
            "check": lambda: check(CheckConfig(task=str(arm), real=real)),
            "tune": lambda: build_experiment(
                TuneConfig(task=str(arm), real=str(real), out=tmp_path / "run")
            ),
        }[command]()
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_times_in_milliseconds_are_refused_even_without_a_video(tmp_path: Path):
    """A step of 50 s would be played for hours."""
    arm = write_arm(tmp_path, TUNE + '[actions]\nactuators = ["shoulder"]\n')
    (tmp_path / "real").mkdir()
    rows = [f"{50 * t},0.1,0.2,0.3" for t in range(30)]
    header = "time,push,measured.shoulder,measured.elbow"
    (tmp_path / "real" / "swing.csv").write_text("\n".join([header, *rows]))
    with pytest.raises(InputError, match=r"its rows come 0.02 times a second, .* in seconds"):
        check(CheckConfig(task=str(arm), real=tmp_path / "real", observe="joints"))
