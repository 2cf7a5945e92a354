"""LeRobotDataset v2.1: what its files hold comes out, and what is unsound is said in one line."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from lerobot_v21 import CAMERA, DATA, EPISODES, INFO, VIDEO, write_v21

from simtune.errors import InputError
from simtune.recordings import open_dataset

FPS, NUM_ROWS = 10.0, (12, 8, 10)
JOINTS = ["pan", "lift", "grip"]


def grey(num: int) -> np.ndarray:
    """(num, 32, 32, 3): frame t is of the grey value 8 t."""
    return np.tile(8 * np.arange(num, dtype=np.uint8)[:, None, None, None], (1, 32, 32, 3))


def shown(frames: np.ndarray) -> list[int]:
    """The inverse of `grey`."""
    return np.rint(frames.mean((1, 2, 3)) / 8).astype(int).tolist()


def write(folder: Path, names: object = None, **options: Any) -> None:
    rng = np.random.default_rng(0)
    episodes = [
        {
            "observation.state": rng.normal(size=(num, 3)),
            "action": rng.normal(size=(num, 3)),
            "frames": grey(num),
        }
        for num in NUM_ROWS
    ]
    named = {"observation.state": names or [JOINTS], "action": names or [JOINTS]}
    write_v21(folder, episodes, named, fps=FPS, **options)


def stored(folder: Path, episode: int, column: str, chunk: int = 0) -> np.ndarray:
    """(T, D) as pyarrow reads it, without any of our code."""
    table = pq.read_table(folder / DATA.format(chunk=chunk, episode=episode))
    return np.array(table[column].to_pylist())


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("v21") / "dataset"
    write(folder)
    return folder


@pytest.fixture
def dataset(written: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(written, tmp_path / "dataset"))


def edit_info(folder: Path, **changes: object) -> None:
    info = json.loads((folder / INFO).read_text())
    (folder / INFO).write_text(json.dumps(info | changes))


def edit_lines(folder: Path, *lines: str) -> None:
    (folder / EPISODES).write_text("\n".join(lines))


def line(episode: int, length: object) -> str:
    return json.dumps({"episode_index": episode, "tasks": ["swing"], "length": length})


def message(folder: Path) -> str:
    """The one line that reading all of it gives, less the folder's name."""

    def read_all() -> None:
        dataset = open_dataset(folder)
        for episode in range(dataset.num_episodes):
            dataset.skim(episode)

    with pytest.raises(InputError) as caught:
        read_all()
    assert "\n" not in str(caught.value)
    return str(caught.value).replace(str(folder), "HERE")


@pytest.mark.parametrize("chunks_size", [1000, 2])
@pytest.mark.parametrize("version", ["v2.1", "v2.0"])
def test_what_its_files_hold_is_read(tmp_path, version, chunks_size):
    folder = tmp_path / "dataset"
    write(folder, version=version, chunks_size=chunks_size)
    dataset = open_dataset(folder)
    assert dataset.num_episodes == len(NUM_ROWS)
    for episode, num in enumerate(NUM_ROWS):
        trajectory = dataset.read(episode)
        actions = stored(folder, episode, "action", episode // chunks_size)
        np.testing.assert_array_equal(trajectory.actions, actions[:-1])
        assert shown(trajectory.frames) == list(range(num))
    facts = dataset.facts(len(NUM_ROWS))
    assert (facts["kind"], facts["cameras"][0]["key"]) == (f"LeRobotDataset {version}", CAMERA)
    assert facts["steps"] == sum(NUM_ROWS) - len(NUM_ROWS)


@pytest.mark.parametrize("names", [JOINTS, [JOINTS], {"motors": JOINTS}, {"a": [JOINTS]}])
def test_names_may_be_nested(tmp_path, names):
    write(tmp_path / "dataset", names)
    assert open_dataset(tmp_path / "dataset").action_names == tuple(JOINTS)


def test_names_may_be_given_with_their_places(tmp_path):
    write(tmp_path / "dataset", {name: place for place, name in reversed([*enumerate(JOINTS)])})
    assert open_dataset(tmp_path / "dataset").action_names == tuple(JOINTS)


@pytest.mark.parametrize("names", [["pan"], [[*JOINTS, "more"]], {"motors": 3}, "pan", [[[[[1]]]]]])
def test_names_that_do_not_fit_are_left_aside(tmp_path, names):
    write(tmp_path / "dataset", names)
    assert open_dataset(tmp_path / "dataset").action_names == ("action_0", "action_1", "action_2")


def test_episodes_come_by_their_index(dataset):
    edit_lines(dataset, line(2, 10), "", line(0, 12), line(1, 8))
    assert open_dataset(dataset).episodes == ["episode 0", "episode 1", "episode 2"]


def test_content_hash_follows_every_file(dataset):
    seen = {open_dataset(dataset).content_hash}
    for name in (INFO, EPISODES, DATA, VIDEO):
        path = dataset / name.format(chunk=0, episode=1)
        path.write_bytes(path.read_bytes() + b"\n")
        seen.add(open_dataset(dataset).content_hash)
    assert len(seen) == 5


def test_list_of_episodes_missing_or_damaged(dataset):
    (dataset / EPISODES).unlink()
    assert message(dataset) == "HERE/meta/episodes.jsonl: missing; copy the dataset again"
    edit_lines(dataset, line(0, 12), line(1, 8)[:20])
    assert message(dataset).startswith("HERE/meta/episodes.jsonl: line 2: not readable as JSON (")
    edit_lines(dataset, line(0, 12), "[1]")
    assert message(dataset) == "HERE/meta/episodes.jsonl: line 2: expected a JSON object, got list"
    (dataset / EPISODES).write_bytes(b"\xff\xfe\0")
    assert message(dataset).startswith("HERE/meta/episodes.jsonl: not readable as JSON (")
    edit_lines(dataset)
    assert message(dataset) == "HERE: holds no episode; expected at least one"


def test_list_of_episodes_odd(dataset):
    edit_lines(dataset, line(0, 12), line(1, 8), line(1, 8))
    assert message(dataset) == "HERE/meta/episodes.jsonl: line 3: episode 1 is listed twice"
    edit_lines(dataset, line(0, 12), line(1, 8))
    assert message(dataset) == (
        "HERE: expected 3 episodes as meta/info.json says, meta/episodes.jsonl lists 2; "
        "copy the dataset again"
    )
    edit_lines(dataset, line(0, 12), line(1, "8"))
    assert message(dataset) == (
        "HERE/meta/episodes.jsonl: line 2: expected a number in 'length', got '8'"
    )
    edit_lines(dataset, line(0, 12), line(1, 1), line(2, 13))
    assert message(dataset) == (
        "HERE: episode 1 has 1 row; expected at least 2, a frame before and a frame after an "
        "action; leave it out (--leave-out 1)"
    )


def test_length_of_another_recording(dataset):
    edit_lines(dataset, line(0, 12), line(1, 9), line(2, 10))
    file = DATA.format(chunk=0, episode=1)
    assert message(dataset) == (
        f"HERE/{file}: expected 9 rows of episode 1, got 8; copy the dataset again"
    )
    shutil.copy(dataset / DATA.format(chunk=0, episode=0), dataset / file)
    assert message(dataset).endswith("expected 9 rows of episode 1, got 0; copy the dataset again")


def test_files_missing(dataset):
    video, data = (name.format(chunk=0, episode=1) for name in (VIDEO, DATA))
    (dataset / video).unlink()
    assert message(dataset) == f"episode 1, step 0: HERE/{video}: no such video"
    (dataset / data).unlink()
    assert message(dataset) == f"HERE/{data}: missing, though the dataset's meta files name it"


@pytest.mark.parametrize("chunks_size", [0, -1, 1.5, "1000", True, None])
def test_chunks_size(dataset, chunks_size):
    edit_info(dataset, chunks_size=chunks_size)
    assert message(dataset) == (
        f"HERE/meta/info.json: expected a whole chunks_size of at least 1, got {chunks_size!r}"
    )


@pytest.mark.parametrize("key", ["data_path", "video_path"])
def test_paths_of_strangers(dataset, key):
    for template in ("../{episode_index:06d}", "/etc/{episode_index}", "a/{episode_index}\n"):
        edit_info(dataset, **{key: template})
        assert message(dataset).endswith(
            "leads out of the dataset; expected all of its files within its folder"
        )
    for template in ("{episode_index.real}", "{episode_index:0999999d}", "all", "{x}", 3):
        edit_info(dataset, **{key: template})
        expected = f"HERE/meta/info.json: expected a {key} like "
        assert message(dataset).startswith(expected), template


def test_without_the_first_episode_its_damaged_video_is_not_read(dataset: Path):
    (dataset / VIDEO.format(chunk=0, episode=0)).write_bytes(b"")
    message(dataset)
    others = open_dataset(dataset, leave_out=["0"])
    assert shown(others.read(0).frames) == list(range(NUM_ROWS[1]))
    assert others.facts(1)["cameras"][0]["codec"] == "h264"


def test_without_the_first_episode_it_may_have_a_single_row(tmp_path: Path):
    episodes = [{"action": np.zeros((num, 1)), "frames": grey(num)} for num in (1, 8, 1)]
    write_v21(tmp_path / "dataset", episodes, {"action": ["a"]}, fps=FPS)
    assert "has 1 row; expected at least 2" in message(tmp_path / "dataset")
    others = open_dataset(tmp_path / "dataset", leave_out=["0"])
    assert len(others.read(0)) == 7
    with pytest.raises(InputError, match=r"\(--leave-out 0,2\)"):  # with what is left out already
        others.read(1)
