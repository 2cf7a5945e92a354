"""Readings beside the frames: chosen by name, at the times of the frames; and without pictures."""

import csv
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from lerobot_v21 import DATA, write_v21

from simtune.between_rows import read_between
from simtune.cameras.footage import Footage
from simtune.checking.recording_warnings import recording_warnings
from simtune.checking.table import table
from simtune.errors import InputError
from simtune.recordings import open_dataset, write_dataset, write_video
from simtune.recordings.readings import choose_readings, readings_of
from simtune.recordings.resample import step_readings
from simtune.recordings.source import Rows
from simtune.tasks import load_task
from simtune.trajectory import Trajectory

FPS, NUM_ROWS = 10.0, 12
JOINTS = ["pan", "lift"]
SENSORS = {"joints": ("lift", "pan"), "force": ("observation.force",)}


def measured(rows: int = NUM_ROWS) -> np.ndarray:
    """(T, 2) of two joints."""
    return np.random.default_rng(1).normal(size=(rows, 2))


def forces() -> np.ndarray:
    """(T, 1) without a name."""
    return np.random.default_rng(2).normal(size=(NUM_ROWS, 1))


def frames() -> np.ndarray:
    return np.zeros((NUM_ROWS, 16, 16, 3), np.uint8)


def commands() -> np.ndarray:
    return np.random.default_rng(3).normal(size=(NUM_ROWS, 1)).astype(np.float32)


def write_lerobot(folder: Path, **columns: np.ndarray) -> None:
    """Two episodes of it, without video."""
    episode = {
        "observation.state": measured(),
        "observation.force": forces(),
        "action": commands(),
        **columns,
    }
    names = {"observation.state": [JOINTS], "observation.force": None, "action": ["servo"]}
    write_v21(folder, [episode, episode], names | dict.fromkeys(columns), fps=FPS)


def write_pairs(folder: Path, *, times: bool = True, video: bool = True) -> None:
    folder.mkdir(exist_ok=True)
    header = ["time"] * times + ["measured.pan", "servo", "measured.lift"]
    if video:
        write_video(folder / "swing.mp4", frames(), FPS)
    with (folder / "swing.csv").open("w", newline="") as file:
        rows = [
            [*([t / FPS] * times), pan, action, lift]
            for t, ((pan, lift), (action,)) in enumerate(
                zip(measured(), commands().tolist(), strict=True)
            )
        ]
        csv.writer(file).writerows([header, *rows])


def write_robomimic(folder: Path, pictures: bool = True) -> None:
    folder.mkdir(exist_ok=True)
    with h5py.File(folder / "demo.hdf5", "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": FPS}})
        for demo in ("demo_0", "demo_1"):
            data[f"{demo}/actions"] = commands()
            data[f"{demo}/obs/robot0_joint_pos"] = measured()
            data[f"{demo}/obs/gripper"] = forces()[:, 0]
            data[f"{demo}/obs/label"] = [b"a"] * NUM_ROWS
            data[f"{demo}/obs/depth"] = np.zeros((NUM_ROWS, 4, 4))
            if pictures:
                data[f"{demo}/obs/front_image"] = frames()


def message(*arguments: Any, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        open_dataset(*arguments, **options).read(0)
    assert "\n" not in str(caught.value)
    return str(caught.value).replace(str(arguments[0]), "HERE")


# --- names --------------------------------------------------------------------------------


KNOWN = [
    *readings_of("observation.state", ("pan", "lift", "grip"), 3),
    *readings_of("observation.velocity", ("pan", "lift"), 2),
    *readings_of("observation.force", (), 2),
    *readings_of("other", ("a", "a", "b"), 3),
]


def chosen(*names: str) -> list[str]:
    return [r.place for r in choose_readings(Path("HERE"), KNOWN, {"joints": names})["joints"]]


@pytest.mark.parametrize(
    ("name", "places"),
    [
        ("observation.state.lift", ["observation.state[1]"]),
        ("observation.state[1]", ["observation.state[1]"]),
        ("grip", ["observation.state[2]"]),
        ("observation.force[1]", ["observation.force[1]"]),
        ("observation.force", ["observation.force[0]", "observation.force[1]"]),
        ("other", ["other[0]", "other[1]", "other[2]"]),
        ("b", ["other[2]"]),
    ],
)
def test_a_reading_is_chosen_by_full_name_short_name_or_place(name: str, places: list[str]):
    assert chosen(name) == places


def test_full_names_are_told_where_there_are_any():
    names = [reading.full_name for reading in KNOWN]
    assert names[:3] == [
        "observation.state.pan",
        "observation.state.lift",
        "observation.state.grip",
    ]
    # Two of one name have none.
    assert names[5:7] == ["observation.force[0]", "observation.force[1]"]
    assert names[7:] == ["other[0]", "other[1]", "other.b"]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (
            ["pan"],
            "HERE: 'pan' can be each of observation.state.pan, observation.velocity.pan; "
            "name one of them",
        ),
        (
            ["griip"],
            "HERE: no reading 'griip'; did you mean 'grip'? there are: observation.state.pan",
        ),
        (["observation.stat.pan"], "did you mean 'observation.state.pan'? there are: "),
        (["a"], "HERE: no reading 'a'; there are: observation.state.pan, "),
        ([""], "HERE: no reading ''; there are: "),
        (["observation.force[2]"], "did you mean 'observation.force[1]'?"),
        (["grip", "observation.state"], "HERE: joints has observation.state.grip twice"),
        ([], "HERE: expected a reading at least for joints, got none"),
    ],
)
def test_what_cannot_be_chosen_is_said_with_what_there_is(names: list[str], said: str):
    with pytest.raises(InputError) as caught:
        chosen(*names)
    assert said in str(caught.value)


def test_recordings_without_readings_say_so(tmp_path):
    write_video(tmp_path / "swing.mp4", frames(), FPS)
    said = message(tmp_path, readings={"joints": ("pan",)})
    assert said == (
        "HERE: no reading 'pan'; the recordings have no readings: "
        "in a CSV, call their columns measured.NAME"
    )


def test_columns_like_a_reading_that_is_called_no_reading_are_named(tmp_path):
    write_log(tmp_path / "log", *((i / 10, i, i, i) for i in range(20)))
    path = tmp_path / "log" / "log.csv"
    path.write_text(path.read_text().replace("measured.arm", "pos.arm"))
    said = message(tmp_path / "log", cameras=(), readings={"arm": ("measured.arm",)})
    assert said.endswith("call their columns measured.NAME (these look like it: arm, pos.arm)")


@pytest.mark.parametrize(
    ("times_s", "said"),
    [
        ([3, 3], "line 3 of HERE/log.csv: is of the same time as line 2, 1700000003.02 s: merge"),
        ([4, 3], "rising seconds, got 1700000003.02 after 1700000004.02: sort the rows by time"),
    ],
)
def test_rows_that_do_not_rise_say_beside_which(tmp_path, times_s, said):
    write_log(tmp_path / "log", *((f"{1_700_000_000 + s}.02", 0, 0, 0) for s in times_s))
    assert said in message(tmp_path / "log", cameras=())


def test_rows_of_two_clocks_say_where_they_jump(tmp_path):
    acted = [(i / 10, i, i, "") for i in range(30)]
    write_log(tmp_path / "log", *acted, *((1e5 + i / 10, "", "", i) for i in range(30)))
    said = message(tmp_path / "log", cameras=())
    assert "they jump by 99997.1 s between lines 31 and 32: if what follows is" in said


@pytest.mark.parametrize("readings_hz", [10, 50])
def test_how_often_readings_were_measured_is_among_the_facts(tmp_path, readings_hz):
    acted = [(0.0041 + i / 20, i, i, "") for i in range(60)]
    measured = [(i / readings_hz, "", "", i) for i in range(3 * readings_hz)]
    write_log(tmp_path / "log", *sorted([*acted, *measured]))
    dataset = open_dataset(tmp_path / "log", readings={"arm": ("measured",)}, cameras=())
    dataset.skim(0)
    facts = dataset.facts(1)
    assert facts["control_hz"] == pytest.approx(20)
    assert facts["readings_hz"] == pytest.approx(readings_hz)


# --- of each kind of recordings ----------------------------------------------------------


def assert_read(folder: Path, sensors: dict[str, tuple[str, ...]], names: Sequence[str]) -> None:
    dataset = open_dataset(folder, readings=sensors, cameras=())
    assert dataset.reading_names == tuple(names)
    trajectory = dataset.read(0)
    joints = trajectory.readings["joints"]
    assert joints.dtype == np.float64
    np.testing.assert_allclose(joints, measured()[:, ::-1], rtol=1e-6)
    if "force" in sensors:
        np.testing.assert_allclose(trajectory.readings["force"], forces(), rtol=1e-6)
    np.testing.assert_array_equal(trajectory.actions, commands()[:-1])
    assert trajectory.frames.shape == (NUM_ROWS, 0, 0, 3)
    assert not trajectory.has_pictures


def test_readings_of_a_lerobot_dataset_are_its_parquet_file_s(tmp_path):
    folder = tmp_path / "dataset"
    write_lerobot(folder)
    names = ["observation.state.pan", "observation.state.lift", "observation.force[0]"]
    assert_read(folder, SENSORS, names)
    state = {"state": ("observation.state",)}
    read = open_dataset(folder, readings=state, cameras=()).read(1).readings["state"]
    stored = pq.read_table(folder / DATA.format(chunk=0, episode=1))["observation.state"]
    np.testing.assert_array_equal(read, np.array(stored.to_pylist()))
    facts = open_dataset(folder, readings=SENSORS, cameras=())
    facts.skim(0)
    assert facts.facts(1)["readings"] == {
        "joints": ["observation.state.lift", "observation.state.pan"],
        "force": ["observation.force[0]"],
    }


def test_readings_of_a_table_are_columns_called_measured(tmp_path):
    write_pairs(tmp_path / "pairs")
    sensors = {"joints": ("lift", "measured.pan")}
    assert_read(tmp_path / "pairs", sensors, ["measured.pan", "measured.lift"])
    dataset = open_dataset(tmp_path / "pairs", readings=sensors)
    assert dataset.action_names == ("servo",)
    trajectory = dataset.read(0)
    assert trajectory.has_pictures
    np.testing.assert_allclose(trajectory.readings["joints"], measured()[:, ::-1])


def test_readings_of_robomimic_are_what_is_observed_and_low_dimensional(tmp_path):
    write_robomimic(tmp_path / "demos")
    names = ["gripper[0]", "robot0_joint_pos[0]", "robot0_joint_pos[1]"]
    sensors = {"joints": ("robot0_joint_pos[1]", "robot0_joint_pos[0]"), "force": ("gripper",)}
    assert_read(tmp_path / "demos", sensors, names)
    trajectory = open_dataset(tmp_path / "demos", readings=sensors).read(0)
    assert trajectory.has_pictures
    np.testing.assert_array_equal(trajectory.readings["joints"], measured()[:, ::-1])


def test_columns_that_nobody_asks_for_are_not_read(tmp_path):
    write_lerobot(tmp_path / "dataset", label=np.full((NUM_ROWS, 1), np.nan))
    path = tmp_path / "dataset" / DATA.format(chunk=0, episode=0)
    broken = pq.read_table(path)
    place = broken.column_names.index("label")
    pq.write_table(broken.set_column(place, "label", [["text"] * NUM_ROWS]), path)
    dataset = open_dataset(tmp_path / "dataset", readings=SENSORS, cameras=())
    assert not np.isnan(dataset.read(0).readings["joints"]).any()
    said = message(tmp_path / "dataset", readings={"label": ("label",)}, cameras=())
    assert said.endswith("expected numbers in column 'label'")


# --- written and read again --------------------------------------------------------------


def trajectory_of(size: int = 0, **changes: Any) -> Trajectory:
    rng = np.random.default_rng(4)
    pictures = np.zeros((NUM_ROWS, size, size, 3), np.uint8)
    readings = {"joints": measured(), "force": forces(), "unsaid": forces()}
    actions = rng.normal(size=(NUM_ROWS - 1, 1)).astype(np.float32)
    return replace(Trajectory(pictures, actions, 1 / FPS, readings), **changes)


def write_back(folder: Path, trajectory: Trajectory, names: dict[str, Sequence[str]]) -> None:
    options: dict[str, Any] = {"action_names": ["servo"], "robot_type": "arm", "task": "swing"}
    write_dataset(folder, [trajectory] * 2, **options, reading_names=names)


NAMES: dict[str, Sequence[str]] = {"force": ["grip.force"], "joints": JOINTS}


@pytest.mark.parametrize("size", [0, 16])
@pytest.mark.parametrize("names", [NAMES, {"force": ["grip"]}])
def test_readings_that_are_written_are_read_again(tmp_path, size, names):
    trajectory = trajectory_of(size)
    trajectory.readings["joints"][3, 1] = np.nan
    write_back(tmp_path / "dataset", trajectory, names)
    dataset = open_dataset(tmp_path / "dataset", readings=names, cameras=(Footage(),) * (size > 0))
    for episode in range(2):
        again = dataset.read(episode)
        assert set(again.readings) == set(names)
        for sensor, values in again.readings.items():
            expected = trajectory.readings[sensor].astype(np.float32)
            np.testing.assert_array_equal(values, expected)
        np.testing.assert_array_equal(again.actions, trajectory.actions)
        assert again.has_pictures == (size > 0)


def test_the_feature_of_readings_is_laid_out_as_lerobot_does_it(tmp_path):
    trajectory = trajectory_of()
    trajectory.readings["joints"][:, 0] = np.nan
    trajectory.readings["joints"][3, 1] = np.nan
    write_back(tmp_path / "dataset", trajectory, NAMES)
    info = json.loads((tmp_path / "dataset/meta/info.json").read_text())
    assert info["features"]["observation.state"] == {
        "dtype": "float32",
        "shape": [3],
        "names": ["grip.force", *JOINTS],
    }
    assert info["video_path"] is None
    assert "video" not in {feature["dtype"] for feature in info["features"].values()}
    assert not (tmp_path / "dataset/videos").exists()
    rows = pq.read_table(tmp_path / "dataset/data/chunk-000/file-000.parquet")
    assert rows.schema.field("observation.state").type.list_size == 3
    schema = json.loads(rows.schema.metadata[b"huggingface"])["info"]["features"]
    assert schema["observation.state"]["length"] == 3
    stats = json.loads((tmp_path / "dataset/meta/stats.json").read_text())["observation.state"]
    lift = np.delete(measured()[:, 1], 3).astype(np.float32)
    assert stats["max"] == [pytest.approx(forces().max()), 0.0, pytest.approx(lift.max())]
    assert stats["mean"][1:] == [0.0, pytest.approx(lift.mean(), abs=1e-6)]
    assert stats["count"] == [2 * NUM_ROWS]


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (
            {"joints": ["pan"]},
            r"trajectory 0: expected readings \(12, 1\) of joints, got \(12, 2\)",
        ),
        ({"torque": ["pan"]}, r"expected readings \(12, 1\) of torque, got \(0, 0\)"),
        ({"joints": ["pan", "pan"]}, "each sensor needs names, and no two the same, got pan, pan"),
        ({"joints": []}, "each sensor needs names"),
    ],
)
def test_readings_that_do_not_fit_their_names_are_refused(tmp_path, names, said):
    with pytest.raises(ValueError, match=said):
        write_back(tmp_path / "dataset", trajectory_of(), names)
    assert not (tmp_path / "dataset").exists()


def test_pictures_that_only_some_episodes_have_are_refused(tmp_path):
    mixed = [trajectory_of(16), trajectory_of()]
    with pytest.raises(ValueError, match=r"trajectory 1: expected frames of \(16, 16\) pixels"):
        write_dataset(
            tmp_path / "dataset", mixed, action_names=["servo"], robot_type="arm", task="swing"
        )


# --- what is missing ---------------------------------------------------------------------


def test_what_was_not_measured_is_nan_and_the_rest_as_it_is(tmp_path):
    state = measured()
    state[3, 0], state[5, 1] = np.inf, np.nan
    write_lerobot(tmp_path / "dataset", **{"observation.state": state})
    dataset = open_dataset(
        tmp_path / "dataset", readings={"joints": ("observation.state",)}, cameras=()
    )
    expected = state.astype(np.float32).astype(float)
    expected[3, 0] = np.nan
    np.testing.assert_array_equal(dataset.read(0).readings["joints"], expected)


def test_a_reading_that_is_never_there_is_refused_by_name(tmp_path):
    write_lerobot(tmp_path / "dataset", **{"observation.force": np.full((NUM_ROWS, 1), np.nan)})
    said = message(tmp_path / "dataset", readings=SENSORS, cameras=())
    assert said == (
        "HERE: episode 0: reading observation.force[0] is missing at every step; "
        "leave the episode out (--leave-out), or do not ask for the reading"
    )
    with pytest.raises(InputError, match="missing at every step"):
        open_dataset(tmp_path / "dataset", readings=SENSORS, cameras=()).skim(0)


def test_empty_cells_of_a_table_are_what_was_not_measured(tmp_path):
    write_pairs(tmp_path / "pairs")
    path = tmp_path / "pairs" / "swing.csv"
    lines = path.read_text().splitlines()
    cells = lines[4].split(",")
    lines[4] = ",".join([cells[0], "", *cells[2:]])
    path.write_text("\n".join(lines))
    read = open_dataset(tmp_path / "pairs", readings={"joints": ("measured",)}).read(0)
    assert np.argwhere(np.isnan(read.readings["joints"])).tolist() == [[3, 0]]
    lines[4] = ",".join([*cells[:2], "", cells[3]])
    path.write_text("\n".join(lines))
    held = open_dataset(tmp_path / "pairs").read(0).actions
    np.testing.assert_allclose(held[:, 0], commands()[[0, 1, 2, 2, *range(4, len(held))], 0])
    lines[4] = ",".join([*cells[:2], "nan", cells[3]])  # what was sent, unlike an empty cell
    path.write_text("\n".join(lines))
    said = message(tmp_path / "pairs")
    assert "line 5 of HERE/swing.csv: action is not finite: [nan]; leave cells empty" in said


def write_log(folder: Path, *rows: tuple[float | str, ...]) -> None:
    folder.mkdir()
    with (folder / "log.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("time", "arm", "grip", "measured.arm"), *rows])


def test_actions_of_a_merged_log_are_held_and_steps_at_their_own_rate(tmp_path):
    """Of three clocks, none of which begins with another; the second action changes at times."""
    arm_s, own_s = 0.104 + np.arange(60) / 20, np.arange(320) / 100
    arm = [(s, i, "" if i % 7 != 1 else i, "") for i, s in enumerate(arm_s.tolist())]
    write_log(tmp_path / "log", *sorted([*arm, *((s, "", "", 3 * s) for s in own_s.tolist())]))
    dataset = open_dataset(tmp_path / "log", readings={"arm": ("measured",)}, cameras=())
    assert 1 / dataset.step_s == pytest.approx(20)
    found = dataset.read(0)
    begun = [*range(1, 60), 59]  # from where both are known; the last is held to the log's end
    assert found.actions[:, 0].tolist() == begun
    assert found.actions[:, 1].tolist() == [1 + i // 7 * 7 for i in range(60)]
    read = found.readings["arm"][:, 0]
    np.testing.assert_allclose(read, 3 * (arm_s[1] + np.arange(61) / 20))
    finer = open_dataset(tmp_path / "log", cameras=(), control_hz=100).read(0).actions[:, 1]
    assert finer.tolist() == [1 + i // 35 * 7 for i in range(len(finer))]


def test_a_log_of_changes_alone_beside_readings_has_the_rate_of_its_rows(tmp_path):
    values = np.repeat([1.0, 2.0, 3.0, 4.0], [9, 1, 30, 10]).tolist()
    is_new = [True, *(np.diff(values) != 0).tolist()]
    cells = [(v, v) if new else ("", "") for v, new in zip(values, is_new, strict=True)]
    write_log(tmp_path / "log", *((i / 10, *its, i) for i, its in enumerate(cells)))
    dataset = open_dataset(tmp_path / "log", cameras=())
    assert (1 / dataset.step_s, dataset.read(0).actions[:, 0].tolist()) == (10, values[:-1])


def test_a_null_row_of_a_lerobot_dataset_is_nan(tmp_path):
    write_lerobot(tmp_path / "dataset")
    path = tmp_path / "dataset" / DATA.format(chunk=0, episode=0)
    stored = pq.read_table(path)
    rows = stored["observation.state"].to_pylist()
    rows[2], rows[4][1] = None, None
    column = stored.column_names.index("observation.state")
    pq.write_table(stored.set_column(column, "observation.state", [rows]), path)
    dataset = open_dataset(tmp_path / "dataset", readings=SENSORS, cameras=())
    missing = np.argwhere(np.isnan(dataset.read(0).readings["joints"]))
    assert missing.tolist() == [[2, 0], [2, 1], [4, 0]]


# --- another rate ------------------------------------------------------------------------


def test_another_rate_has_each_measurement_at_the_step_nearest_to_it(tmp_path):
    write_lerobot(tmp_path / "dataset")
    sensors, rows = {"joints": ("observation.state",)}, np.arange(NUM_ROWS)
    for control_hz in (4.0, 25.0, 7.0):
        dataset = open_dataset(
            tmp_path / "dataset", readings=sensors, cameras=(), control_hz=control_hz
        )
        got = dataset.read(0).readings["joints"]
        assert len(got) == int((NUM_ROWS - 1) / FPS * control_hz + 0.02) + 1
        nearest = np.floor(rows / FPS * control_hz + 0.5 + 1e-6).astype(int)
        (steps,) = np.nonzero(np.isfinite(got[:, 0]))
        assert steps.tolist() == sorted({n for n in nearest.tolist() if n < len(got)})
    on_rows = open_dataset(tmp_path / "dataset", readings=sensors, cameras=(), control_hz=2 * FPS)
    np.testing.assert_allclose(on_rows.read(0).readings["joints"][::2], measured(), atol=1e-6)


def test_nothing_is_made_up_where_nothing_was_measured():
    values = np.arange(10.0)[:, None]
    values[4] = np.nan
    rows = Rows(np.zeros((10, 1)), np.arange(10) / 10, 1.0, values)
    read = step_readings(rows, np.arange(21) / 20)[:, 0]
    assert np.flatnonzero(np.isfinite(read)).tolist() == [0, 2, 4, 6, 10, 12, 14, 16, 18]
    np.testing.assert_array_equal(read[:19:2], values[:, 0])
    times_s = np.delete(np.arange(14), [3, 4, 8, 9, 10]) / 10
    rows = Rows(np.zeros((9, 1)), times_s, 1.3, times_s[:, None])
    read = step_readings(rows, np.arange(14) / 10)[:, 0]
    assert np.flatnonzero(np.isnan(read)).tolist() == [3, 4, 8, 9, 10]
    assert np.isnan(step_readings(rows, np.arange(14) / 10 + 0.03)[7, 0])  # three are missing
    assert np.isfinite(step_readings(rows, np.arange(14) / 10 + 0.03)[2, 0])  # two


def merged_log(own_s: np.ndarray, acted_s: np.ndarray) -> Rows:
    """What an outer join makes of an encoder's log and of one of actions: empty cells."""
    times_s = np.union1d(own_s, acted_s)
    values = np.where(np.isin(times_s, own_s), np.sin(3 * times_s), np.nan)
    return Rows(np.zeros((len(times_s), 1)), times_s, float(times_s[-1]), values[:, None])


@pytest.mark.parametrize("own_hz", [100, 20])
def test_an_encoder_on_a_clock_of_its_own_is_read_between_its_own_rows(own_hz):
    grid_s = np.arange(200) / 20  # the actions', at which the encoder has no row
    own_s = 0.003 + np.arange(10 * own_hz) / own_hz
    read = step_readings(merged_log(own_s, grid_s), grid_s)[:, 0]
    assert np.flatnonzero(np.isnan(read)).tolist() == [0]
    np.testing.assert_allclose(read[1:], np.sin(3 * grid_s[1:]), atol=1e-5)
    gap = (own_s < 4) | (own_s > 4.2)
    read = step_readings(merged_log(own_s[gap], grid_s), grid_s)[:, 0]
    assert np.flatnonzero(np.isnan(read)).tolist() == [0, 80, 81, 82, 83, 84]


@pytest.mark.parametrize("jitter", [0.0, 0.2])
@pytest.mark.parametrize("own_hz", [25, 12.5, 6.25])
def test_an_encoder_slower_than_steps_has_no_more_readings_than_it_measured(own_hz, jitter):
    rng = np.random.default_rng(0)
    grid_s = np.arange(500) / 50
    own_s = grid_s[:: round(50 / own_hz)].copy()
    own_s[1:-1] += rng.uniform(-jitter, jitter, len(own_s) - 2) / 50
    rows = merged_log(own_s, np.array([0.0, 9.98]))
    for hz in (50, 30, 20):
        steps_s = np.arange(int(9.98 * hz)) / hz
        read = step_readings(rows, steps_s)[:, 0]
        (known,) = np.nonzero(np.isfinite(read))
        assert 0.95 * len(own_s) <= len(known) <= len(own_s) or own_hz > hz
        assert np.abs(steps_s[known, None] - own_s).min(1).max() <= 0.5001 / hz
        np.testing.assert_allclose(
            read[known], np.sin(3 * steps_s[known]), atol=4e-3
        )  # 1 ms is as good


def test_a_lost_packet_stays_among_its_neighbours_and_bursts_tell_no_slope():
    times_s = np.arange(60) / 30
    values = np.where(np.arange(60) == 30, 100.0, 0.0)
    read = read_between(times_s + 0.4 / 30, times_s, values)
    assert np.flatnonzero(np.abs(read) > 1e-9).tolist() == [27, 28, 29, 30, 31, 32]
    rows, rng = np.arange(90), np.random.default_rng(0)
    bursts_s = rows // 3 * 0.06 + rows % 3 * 0.001
    noisy = bursts_s + 1e-3 * rng.normal(size=90)
    between_s = np.arange(29) * 0.06 + 0.03
    np.testing.assert_allclose(read_between(between_s, bursts_s, noisy), between_s, atol=5e-3)


def test_clocks_that_jitter_a_little_leave_readings_as_they_are():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(30, 2))
    values[7] = np.nan
    times_s = (np.arange(30) + rng.uniform(-0.01, 0.01, 30)) / 30
    rows = Rows(np.zeros((30, 1)), times_s, times_s[-1], values)
    np.testing.assert_array_equal(step_readings(rows, np.arange(30) / 30), values)


def test_a_table_that_ends_before_its_video_has_no_last_reading(tmp_path):
    write_pairs(tmp_path / "pairs", times=False)
    path = tmp_path / "pairs" / "swing.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:-1]))
    read = open_dataset(tmp_path / "pairs", readings={"joints": ("measured",)}).read(0)
    joints = read.readings["joints"]
    np.testing.assert_allclose(joints[:-1], measured()[:-1])
    assert np.isnan(joints[-1]).all()


# --- without pictures --------------------------------------------------------------------


@pytest.mark.parametrize("camera", [None, "nowhere"])
def test_without_pictures_no_camera_has_to_exist(tmp_path, camera):
    write_lerobot(tmp_path / "lerobot")
    write_pairs(tmp_path / "pairs", video=False)
    write_robomimic(tmp_path / "demos", pictures=False)
    for kind, said in (
        ("lerobot", "no camera"),
        ("pairs", "swing.csv has no swing.mp4 or .mov"),
        ("demos", "no pictures"),
    ):
        dataset = open_dataset(tmp_path / kind, cameras=())
        trajectory = dataset.read(0)
        assert len(trajectory) == NUM_ROWS - 1
        actions, film = dataset.skim(0, num_kept=3)
        np.testing.assert_array_equal(actions, trajectory.actions)
        assert film.shape == (0, 0, 0, 3)
        assert said in message(tmp_path / kind)


@pytest.mark.parametrize("video", [False, True])
def test_pairs_are_told_by_what_is_there(tmp_path, video):
    write_pairs(tmp_path / "pairs", video=video)
    dataset = open_dataset(tmp_path / "pairs", cameras=())
    dataset.read(0)
    assert dataset.facts(1)["kind"] == ("folder of mp4 and csv" if video else "folder of csv")


def shift_times(path: Path, by_s: float) -> None:
    rows = list(csv.reader(path.open()))
    shifted = [[f"{float(time_s) + by_s:.6f}", *others] for time_s, *others in rows[1:]]
    path.write_text("\n".join(map(",".join, [rows[0], *shifted])))


@pytest.mark.parametrize(("video", "by_s"), [(False, -0.0004), (False, -7.0), (True, -0.4 / FPS)])
def test_rows_may_begin_before_zero(tmp_path, video, by_s):
    """As clocks round; a table's zero may be anywhere if there is no video."""
    write_pairs(tmp_path / "pairs", video=video)
    options: dict[str, Any] = {} if video else {"cameras": ()}
    expected = open_dataset(tmp_path / "pairs", **options).read(0)
    shift_times(tmp_path / "pairs" / "swing.csv", by_s)
    found = open_dataset(tmp_path / "pairs", **options).read(0)
    np.testing.assert_array_equal(found.actions, expected.actions[: len(found)])
    assert len(expected) - len(found) <= video  # the last is not over at the last frame


def test_rows_may_not_begin_before_the_first_frame(tmp_path):
    write_pairs(tmp_path / "pairs")
    shift_times(tmp_path / "pairs" / "swing.csv", -0.6 / FPS)
    assert "line 2 of HERE/swing.csv: expected rising seconds since the video's first frame" in (
        message(tmp_path / "pairs")
    )


def test_a_table_without_times_needs_its_video_s(tmp_path):
    write_pairs(tmp_path / "pairs", times=False)
    sensors = {"joints": ("lift", "pan")}
    assert_read(tmp_path / "pairs", sensors, ["measured.pan", "measured.lift"])
    (tmp_path / "pairs" / "swing.mp4").unlink()
    assert message(tmp_path / "pairs", cameras=()) == (
        "HERE/swing.csv: says nowhere when its rows were, and no video does; "
        "expected a column 'time' of seconds"
    )


def test_facts_without_pictures_leave_out_what_tells_of_them(tmp_path):
    write_lerobot(tmp_path / "dataset")
    dataset = open_dataset(tmp_path / "dataset", readings=SENSORS, cameras=())
    actions = [dataset.skim(episode)[0] for episode in range(2)]
    facts = json.loads(json.dumps(dataset.facts(2)))
    assert facts["cameras"] == []
    assert (facts["steps"], facts["fps"]) == (2 * (NUM_ROWS - 1), FPS)
    # Those who read the facts cope.
    task = load_task("cartpole")
    assert not any("frames" in said for said in recording_warnings(task, facts, actions, 2))
    result = {"task": "cartpole", "episodes": 2, "steps": 11, "step_s": 0.1, "recordings": facts}
    printed = table(result | {"parameters": {}, "pairs": []})
    assert f"{2 * (NUM_ROWS - 1)} steps, no pictures looked at" in printed[1]


def test_videos_that_nobody_looks_at_do_not_count_as_content(tmp_path):
    write_pairs(tmp_path / "pairs")
    hashes = []
    for _ in range(2):
        hashes.append(open_dataset(tmp_path / "pairs", cameras=()).content_hash)
        write_video(tmp_path / "pairs" / "swing.mp4", frames() + 200, FPS)
    assert hashes[0] == hashes[1]


def test_a_trajectory_knows_whether_it_has_pictures():
    actions = np.zeros((2, 1), np.float32)
    assert Trajectory(np.zeros((3, 4, 4, 3), np.uint8), actions, 0.1).has_pictures
    blind = Trajectory(np.zeros((3, 0, 0, 3), np.uint8), actions, 0.1)
    assert not blind.has_pictures
    assert blind.first(1).frames.shape == (2, 0, 0, 3)
