"""Recordings as arrays: files of numpy.savez, and what Python has in memory."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from test_recording_kinds import FPS, NUM_STEPS, actions, assert_whole, grey, message, shown

import simtune
from simtune.api.arrays import film_once, write_arrays
from simtune.cameras.footage import Footage
from simtune.config import RealConfig
from simtune.errors import InputError
from simtune.real.choose import choose_real
from simtune.recordings import open_dataset
from simtune.recordings.arrays import ArraysSource
from simtune.recordings.source import Rows
from simtune.tasks import load_task
from simtune.tuning_run import tune as tune_from_options


def episode(**changed) -> dict:
    plain = {"hz": FPS, "actions": actions(), "frames": grey(range(NUM_STEPS + 1))}
    return {key: value for key, value in (plain | changed).items() if value is not None}


def write(folder: Path, *episodes: dict) -> Path:
    folder.mkdir()
    for i, arrays in enumerate(episodes or (episode(),)):
        np.savez(folder / f"swing{i + 9}.npz", **arrays)
    return folder


def test_a_frame_before_each_action_and_one_after_the_last(tmp_path):
    dataset = open_dataset(write(tmp_path / "a", episode(), episode(hz=FPS)), num_actions=3)
    assert_whole(dataset)
    assert list(dataset.episodes) == ["swing9", "swing10"]  # as people count
    assert dataset.action_names == ("action_0", "action_1", "action_2")


def test_without_the_last_frame_the_last_action_is_left_out(tmp_path):
    cut = episode(frames=grey(range(NUM_STEPS)))
    assert_whole(open_dataset(write(tmp_path / "a", cut)), frames=NUM_STEPS)


def test_names_cameras_and_readings(tmp_path):
    joints = np.arange(2.0 * (NUM_STEPS + 1)).reshape(-1, 2)
    several = episode(
        frames=None,
        joints=joints,
        force=joints[:, 0],
        action_names=["x", "y", "grip"],
        **{"frames.front": grey(range(NUM_STEPS + 1)), "frames.wrist": grey([3] * (NUM_STEPS + 1))},
    )
    folder = write(tmp_path / "a", several)
    asked = {"sensor": ["joints", "force"]}
    dataset = open_dataset(folder, cameras=[Footage(key="wrist")], actions=["grip"], readings=asked)
    trajectory = dataset.read(0)
    assert set(shown(trajectory.frames)) == {3}
    np.testing.assert_array_equal(trajectory.actions, actions()[:, 2:])
    expected = np.column_stack([joints, joints[:, 0]])
    np.testing.assert_allclose(trajectory.readings["sensor"], expected)
    assert "has several cameras" in message(folder)
    assert open_dataset(folder, cameras=(), readings=asked).read(0).frames.size == 0


def test_only_what_is_needed_is_read(tmp_path, monkeypatch):
    """Not the pictures of a camera that nobody looks at, which fill the memory."""
    cameras = {f"frames.{name}": grey(range(NUM_STEPS + 1)) for name in ("front", "wrist")}
    joints = np.zeros((NUM_STEPS + 1, 2))
    folder = write(tmp_path / "a", episode(frames=None, joints=joints, force=joints, **cameras))
    read, whole = set(), np.lib.npyio.NpzFile.__getitem__

    def note(self, key: str) -> np.ndarray:
        read.add(key)
        return whole(self, key)

    monkeypatch.setattr(np.lib.npyio.NpzFile, "__getitem__", note)
    open_dataset(folder, cameras=(), readings={"arm": ["joints"]}).read(0)
    assert read == {"hz", "actions", "joints"}
    open_dataset(folder, cameras=[Footage(key="front")]).read(0)
    assert read == {"hz", "actions", "joints", "frames.front"}


def of_two_cameras(num_wrist: int, num_front: int = NUM_STEPS + 1) -> dict:
    """With frames that show their number."""
    wrist = np.arange(num_wrist) % (NUM_STEPS + 1)
    both = {"frames.front": grey(range(num_front)), "frames.wrist": grey(wrist.tolist())}
    return episode(frames=None, **both)


@pytest.mark.parametrize("names", [("front", "wrist"), ("wrist", "front")])
@pytest.mark.parametrize("num_wrist", [5, 400])
def test_each_camera_has_a_frame_before_each_action(tmp_path, names, num_wrist):
    folder = write(tmp_path / "a", of_two_cameras(NUM_STEPS + 1), of_two_cameras(num_wrist))
    dataset = open_dataset(folder, cameras=[Footage(key=name) for name in names])
    dataset.read(0)
    with pytest.raises(InputError, match=rf"swing10\.npz: .* rows \{{'frames.wrist': {num_wrist}"):
        dataset.skim(1)


@pytest.mark.parametrize("names", [("front", "wrist"), ("wrist", "front")])
def test_an_episode_ends_where_its_shortest_camera_does(tmp_path, names):
    folder = write(tmp_path / "a", of_two_cameras(NUM_STEPS))
    trajectory = open_dataset(folder, cameras=[Footage(key=name) for name in names]).read(0)
    np.testing.assert_array_equal(trajectory.actions, actions()[: NUM_STEPS - 1])
    for view in np.split(trajectory.frames, 2, axis=2):
        assert shown(view) == list(range(NUM_STEPS))


def test_a_late_camera_ends_an_episode_no_earlier_if_it_films_on(tmp_path):
    folder = write(tmp_path / "a", of_two_cameras(NUM_STEPS + 1, num_front=NUM_STEPS))
    late = [Footage(key="front"), Footage(key="wrist", latency_s=1 / FPS)]
    front, wrist = np.split(open_dataset(folder, cameras=late).read(0).frames, 2, axis=2)
    assert shown(front) == list(range(NUM_STEPS))
    assert shown(wrist) == list(range(1, NUM_STEPS + 1))


def test_rows_are_read_once_for_each_camera(tmp_path, monkeypatch):
    folder = write(tmp_path / "a", *[of_two_cameras(NUM_STEPS + 1)] * 2)
    dataset = open_dataset(folder, cameras=[Footage(key=name) for name in ("front", "wrist")])
    dataset.read(0)
    read, rows = [], ArraysSource.rows

    def note(self, *args) -> Rows:
        read.append(self.camera)
        return rows(self, *args)

    monkeypatch.setattr(ArraysSource, "rows", note)
    dataset.read(1)
    assert read == ["frames.front", "frames.wrist"]


def test_no_picture_stands_in_for_one_beyond_the_last(tmp_path):
    source = ArraysSource(write(tmp_path / "a"))
    last_s = NUM_STEPS / FPS
    ((_, frame),) = source.pictures(0, np.array([last_s + 0.4 / FPS]))
    assert shown(frame[None]) == [NUM_STEPS]
    with pytest.raises(InputError, match=r"swing9\.npz: has 25 pictures at 10 Hz; expected one at"):
        next(source.pictures(0, np.array([last_s + 0.6 / FPS])))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"hz": None}, "has no hz; there are: actions, frames"),
        ({"hz": 0.0}, "expected hz as rows a second, got 0"),
        ({"hz": np.array([20.0])}, "expected hz as one number, got numbers of shape (1,)"),
        ({"hz": np.array("20")}, "expected hz as one number, got one text"),
        ({"frames": None}, "has no pictures; expected frames (T + 1, H, W, 3) uint8"),
        ({"frames": np.zeros((25, 8, 8, 3))}, "expected frames as (T + 1, H, W, 3) uint8"),
        ({"frames": np.zeros((25, 8, 8), np.uint8)}, "expected frames as numbers of 4 axes"),
        ({"frames": grey(range(9))}, "got 24 actions and rows {'frames': 9}"),
        ({"actions": np.zeros((24, 2, 2))}, "expected actions as (T, D)"),
        ({"actions": np.array(["up"] * 24)}, "as numbers, got texts of shape (24,)"),
        ({"actions": np.full((24, 3), np.nan)}, "action"),
        ({"action_names": ["x"]}, "expected action_names as 3 texts"),
        ({"action_names": np.array(["x", "y", "z"], object)}, "action_names holds Python objects"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(tmp_path, changed, said):
    text = message(write(tmp_path / "a", episode(**changed)))
    assert said in text
    assert "\n" not in text


@pytest.mark.parametrize("names", [np.array(list("xyz"), object), [b"x", b"y", b"z"]])
def test_names_of_actions_in_memory_may_be_of_a_pandas_table(tmp_path, names):
    """Whose columns' names are Python objects; or bytes."""
    dataset = open_dataset(write_arrays([episode(action_names=names)], tmp_path))
    assert dataset.action_names == ("x", "y", "z")
    with pytest.raises(InputError, match="expected action_names as texts, got Python objects"):
        write_arrays([episode(action_names=np.array(["x", None, "z"], object))], tmp_path)


def test_damaged_files_and_other_episodes_are_said_in_a_line(tmp_path):
    folder = write(tmp_path / "a", episode(), episode(actions=actions()[:, :2]))
    assert (
        "expected the actions of swing9.npz (action_0, action_1, action_2), got action_0, action_1"
        in message(folder)
    )
    path = folder / "swing9.npz"
    whole = path.read_bytes()
    listed = whole.index(b"PK\x01\x02")  # the first of the zip's list: 8 bytes on, its flags
    encrypted = whole[: listed + 8] + b"\1" + whole[listed + 9 :]
    packed_oddly = whole[: listed + 10] + b"\x63" + whole[listed + 11 :]
    unfinished = whole.replace(b"}", b" ", 1)  # in the header of an array
    cut = whole[: len(whole) // 2]
    for damaged in (b"", b"no zip", cut, b"PK" + whole[40:], encrypted, packed_oddly, unfinished):
        path.write_bytes(damaged)
        assert "not readable as arrays" in message(folder)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"hz": 2 * FPS}, "give one rate for all as --control-hz"),
        ({"action_names": ["b", "a", "c"]}, "expected the actions of swing9.npz (a, b, c), got b"),
        ({"joints": np.zeros((NUM_STEPS + 1, 1))}, "expected 2 numbers of joints in a row"),
    ],
)
def test_later_files_are_as_the_first_or_refused(tmp_path, other, said):
    first = {"joints": np.zeros((NUM_STEPS + 1, 2)), "action_names": ["a", "b", "c"]}
    folder = write(tmp_path / "a", episode(**first), episode(**(first | other)))
    dataset = open_dataset(folder, readings={"arm": ["joints"]})
    with pytest.raises(InputError) as caught:
        dataset.read(1)
    assert said in str(caught.value)


def test_what_is_no_episode_is_left_alone(tmp_path):
    folder = write(tmp_path / "a", episode(depth=np.zeros((NUM_STEPS + 1, 2, 2)), task="swing"))
    (folder / "._swing9.npz").write_bytes(b"macOS writes such files")
    assert_whole(open_dataset(folder, num_actions=3))


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ((NUM_STEPS + 1, 2048), "as (T, D) with T up to 100000 and D up to 1000, got (25, 2048)"),
        ((NUM_STEPS + 1, 1, 1), "expected embedding as (T, D) with T up to 100000"),
        ((200_000,), "got 24 actions and rows {'embedding': 200000, 'frames': 25}"),
    ],
)
def test_an_array_beyond_any_reading_matters_only_to_who_asks_for_it(tmp_path, shape, said):
    folder = write(tmp_path / "a", episode(embedding=np.zeros(shape, np.float32)))
    assert_whole(open_dataset(folder, num_actions=3))
    assert said in message(folder, readings={"arm": ["embedding"]})


def test_why_an_array_is_none_is_said_as_its_library_says_it(tmp_path):
    class Tensor:
        def __array__(self, dtype=None, copy=None):
            raise RuntimeError("Can't call numpy() on Tensor that requires grad.")

    with pytest.raises(InputError, match=r"expected joints as an array: .* requires grad") as error:
        write_arrays([episode(joints=Tensor())], tmp_path / "none")
    assert "length" not in str(error.value)


def test_arrays_in_memory_are_written_once_by_what_they_hold(tmp_path):
    one, again = (write_arrays([episode(), episode()], tmp_path) for _ in range(2))
    assert one == again
    assert_whole(open_dataset(one))
    assert write_arrays([episode(hz=FPS + 1)], tmp_path) != one
    assert {path.name for path in one.iterdir()} == {"episode_0.npz", "episode_1.npz"}
    with pytest.raises(InputError, match="holds no episode"):
        write_arrays([], tmp_path)
    with pytest.raises(InputError, match=r"real\[0\] is a list; expected a dict"):
        write_arrays([[1]], tmp_path)
    with pytest.raises(InputError, match=r"real\[0\]: expected frames as numbers, got Python obj"):
        write_arrays([episode(frames=[None])], tmp_path)
    with pytest.raises(InputError, match=r"real\[0\]: expected hz as one number, got one text"):
        write_arrays([episode() | {"hz": "20"}], tmp_path)
    whole = episode()
    with pytest.raises(InputError, match=r"real\[1\]: expected a row of frames .* got 3 rows"):
        write_arrays([whole, whole | {"frames": whole["frames"][:3]}], tmp_path / "none")
    with pytest.raises(InputError, match=r"real\[0\]: expected at least 2 actions, .* got 1"):
        write_arrays([whole | {"actions": whole["actions"][:1]}], tmp_path / "none")
    with pytest.raises(InputError, match="real is a dict; expected a path, a list of dicts"):
        write_arrays(whole, tmp_path / "none")
    with pytest.raises(InputError, match="real is a int; expected a path, a list of dicts"):
        write_arrays(3, tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"hz": None}, r"real\[0\]: has no hz; there are: actions, frames"),
        ({"actions": None}, r"real\[0\]: has no actions; there are: frames, hz"),
        ({"hz": 0}, r"real\[0\]: expected hz as rows a second, got 0"),
        ({"actions": np.full((NUM_STEPS, 3), np.nan)}, r"real\[0\]: expected finite actions"),
        ({"actions": [[1, 2], [3]]}, r"real\[0\]: expected actions as an array, its rows of one l"),
        (
            {"file": np.zeros(NUM_STEPS)},
            r"real\[0\]: expected texts .*, except 'file'",
        ),
        ({1: np.zeros(NUM_STEPS)}, r"real\[0\]: expected texts as names of arrays, .*; got 1"),
        (
            {"frames": np.zeros((NUM_STEPS, 8, 8, 3))},
            r"real\[0\]: expected frames as \(T \+ 1, H, W, 3\) uint8, got .* float64",
        ),
    ],
)
def test_what_cannot_be_an_episode_is_refused_before_it_is_written(tmp_path, wrong, said):
    changed = {key: value for key, value in (episode() | wrong).items() if value is not None}
    with pytest.raises(InputError, match=said):
        write_arrays([changed], tmp_path / "none")
    assert not (tmp_path / "none").exists()
    asked = []

    def record(i: int) -> dict:
        asked.append(i)
        return changed

    with pytest.raises(InputError, match=said):
        film_once(record, 3, tmp_path / "filmed")
    assert asked == [0]  # the robot does not go on in vain
    assert open_dataset(film_once(lambda _: episode(), 2, tmp_path / "filmed")).num_episodes == 2


def test_arrays_without_pictures_are_named_as_in_python():
    with pytest.raises(ValueError, match=r"^real\[0\]: has no pictures; .* are: actions, hz$"):
        simtune.check("cartpole", real=[{"hz": 12.5, "actions": np.zeros((8, 1))}])


@pytest.mark.thorough
def test_check_takes_arrays(small_library):
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 255, (22, 48, 64, 3), np.uint8)  # of the shortest that is tuned to
    real = [{"hz": 12.5, "actions": rng.uniform(-1, 1, (21, 1)), "frames": frames}]
    found = simtune.check("cartpole", real=lambda i: real[i], episodes=1, image_size=32)
    assert found["recordings"]["episodes"] == 1
    assert "folder of arrays" in str(found)


@pytest.mark.slow
def test_a_run_of_arrays_keeps_them_and_goes_on_with_the_same(quickly, tmp_path, monkeypatch):
    with quickly() as settings:
        world, _, _ = choose_real(RealConfig(), load_task("cartpole"), 64)
        real = [
            {"hz": 1 / film.step_s, "actions": film.actions, "frames": film.frames}
            for film in world.collect(2)
        ]
        one_round = replace(settings, search=replace(settings.search, num_rounds=1))
        quick = partial(tune_from_options, settings=one_round)
        monkeypatch.setattr("simtune.tuning_run.tune", quick)
        tune = partial(simtune.tune, "cartpole", out=tmp_path / "run", seed=3, image_size=32)
        found = tune(real=real)
        assert Path(found.content["recordings"]["folder"]).parent == tmp_path / "run" / "filmed"
        assert tune(real=real).content["parameters"] == found.content["parameters"]
        real[0]["frames"] = 255 - real[0]["frames"]
        with pytest.raises(ValueError, match=r"holds a run with other recordings than \S+: give"):
            tune(real=real)


def test_what_a_robots_function_films_is_filmed_once(tmp_path, caplog):
    asked = []

    def record(i: int) -> dict:
        asked.append(i)
        return episode()

    first = film_once(record, 3, tmp_path)
    assert not caplog.text
    again = film_once(record, 3, tmp_path)
    assert "3 episodes filmed earlier are used, and not filmed again; give another" in caplog.text
    assert asked == [0, 1, 2]
    assert first == again
    assert open_dataset(first, num_actions=3).num_episodes == 3


def test_filming_that_was_interrupted_goes_on_with_the_next_episode(tmp_path, caplog):
    asked = []

    def record(i: int) -> dict:
        asked.append(i)
        if asked == [0, 1]:
            raise KeyboardInterrupt
        return episode()

    with pytest.raises(KeyboardInterrupt):
        film_once(record, 3, tmp_path)
    path = film_once(record, 3, tmp_path)
    assert asked == [0, 1, 1, 2]
    assert "1 episodes filmed earlier are used" in caplog.text
    assert sorted(file.name for file in path.iterdir()) == [f"episode_{i}.npz" for i in range(3)]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"precision": "much"}, "precision must be"),
        ({"budget": 3}, "budget"),
        ({"seed": -1}, "seed"),
    ],
)
def test_a_robot_films_nothing_for_options_that_are_wrong(options, complaint, tmp_path):
    def record(i: int) -> dict:
        raise AssertionError("it moved")

    with pytest.raises(ValueError, match=complaint):
        simtune.tune("cartpole", out=tmp_path / "run", real=record, **options)
    assert not (tmp_path / "run").exists()
