"""Tuning by joint readings alone: found again, in recordings, and scored on others."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.special import ndtri, stdtrit
from servo_arm import HEAD, SHOULDER, TUNE, write_arm

from simtune.before_after.readings import Replayed, Tuned, replay
from simtune.budget import Budget
from simtune.config import EvaluateConfig, RecordConfig, TuneConfig
from simtune.errors import InputError
from simtune.evaluation.evaluate import evaluate
from simtune.evaluation.replay import (
    _late,
    astray,
    better_in,
    far_episodes,
    far_off,
    only_early,
)
from simtune.evaluation.table import table
from simtune.experiment.experiment import Experiment, build_experiment
from simtune.filming import record
from simtune.fit import (
    Guess,
    OutputErrorFit,
    OutputErrorMethod,
    Readings,
    ReplayStage,
)
from simtune.fit.elimination import NormalEquations
from simtune.fit.readings.differences import DifferencePoint, differentiate
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.normal_equations import jackknife, jackknife_std
from simtune.fit.readings.segments import Segments
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace, dynamics
from simtune.randomization import Distribution
from simtune.run.files import read_json, write_json
from simtune.run_data import RunData
from simtune.simulation import Simulator
from simtune.tasks import load_task
from simtune.trajectory import Trajectory
from simtune.tuning.readings.agreement import BestDescent
from simtune.tuning.readings.horizons import Latency
from simtune.tuning.readings.search import ReadingsSearch
from simtune.tuning.readings.verdict import ReadingsResult, _along_sums, conclude
from simtune.tuning.readings.warnings import Unmeasured
from simtune.tuning_run import tune

TRUTH = {"shoulder_kp": 60.0, "shoulder_kv": 4.0, "elbow_kp": 14.0, "elbow_friction": 0.3}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def truth(arm: Path) -> Path:
    path = arm.parent / "truth.json"
    path.write_text(json.dumps(TRUTH))
    return path


def pseudo(arm: Path, truth: Path | None, out: Path, seed: int = 0) -> Experiment:
    config = TuneConfig(task=str(arm), out=out, real_parameters=truth, real_episodes=4, seed=seed)
    return build_experiment(config)


def errors_in_std(experiment: Experiment, real: list[Trajectory]) -> np.ndarray:
    """(N,) errors, in terms of the standard deviations that are claimed."""
    found, space = experiment.search.run_round(real, Budget()).estimate, experiment.space
    width = space.to_unit(found.high) - space.to_unit(found.low)
    return (space.to_unit(found.mean) - space.to_unit(space.from_dict(TRUTH))) / (width / 3.29)


def test_no_camera_is_looked_at_where_sensors_measure(arm: Path, truth: Path, tmp_path: Path):
    experiment = pseudo(arm, truth, tmp_path / "run")
    (first, *_) = experiment.recordings
    assert not first.has_pictures
    assert first.readings["encoders"].shape == (61, 2)
    with pytest.raises(ValueError, match="no camera"):
        experiment.simulator.render(np.zeros((1, 5)), experiment.space.nominal[None])


@pytest.mark.thorough
def test_servos_are_found_again_within_their_intervals(arm: Path, truth: Path, tmp_path: Path):
    experiment = pseudo(arm, truth, tmp_path / "run")
    found, _, metrics = experiment.search.run_round(experiment.recordings, Budget())
    real = experiment.space.from_dict(TRUTH)
    assert np.abs(found.mean / real - 1).max() < 0.05
    assert (found.low < real).all()
    assert (real < found.high).all()
    assert found.verdict == ["identified"] * 4
    # Noise of .002 rad, known from nothing but what is left
    assert metrics["rms/shoulder"] == pytest.approx(0.002, rel=0.1)


@pytest.mark.thorough
def test_a_round_short_of_time_may_be_followed_by_another(arm: Path, truth: Path, tmp_path: Path):
    """As its warning asks for: from where it ended, also in a later session."""
    experiment, later = (pseudo(arm, truth, tmp_path / name) for name in ("one", "other"))
    search, real = experiment.search, experiment.recordings
    short = search.run_round(real, Budget(0.01)).estimate
    assert any("Give it more minutes" in warning for warning in short.warnings)
    assert not search.stop_reason
    later.search.load({}, json.loads(json.dumps(search.state())))
    assert isinstance(later.search, ReadingsSearch)
    np.testing.assert_allclose(later.search.distribution.mean, short.mean)
    found = later.search.run_round(real, Budget()).estimate
    assert found.verdict == ["identified"] * 4
    assert later.search.stop_reason


def test_two_that_do_the_same_are_not_told_apart_by_their_own_curvature(tmp_path: Path):
    arm = write_arm(tmp_path)
    own = 'name = "elbow_friction"\nkind = "friction_loss"\nobjects = "elbow"\nnominal = 0.2'
    same = 'name = "damping"\nkind = "damping"\nobjects = "shoulder"\nnominal = 1.5'
    arm.write_text(arm.read_text().replace(own, same))
    experiment = pseudo(arm, None, tmp_path / "run")
    context, names = experiment.context, experiment.space.names
    assert isinstance(context.simulator, Simulator)
    loop = set_up_loop(context.simulator, context.observation, context.start)
    readings = Readings.of(experiment.recordings, loop.sensors)
    unit, whole = experiment.space.to_unit(context.start), readings.actions.shape[1]
    stretches = loop.cut(readings, unit, segments=Segments.evenly(readings, whole, 9))
    start_std = loop.measured.start_std(np.full(2, 0.002), stretches)
    of_kv, of_damping = names.index("shoulder_kv"), names.index("damping")
    share = context.start[of_kv] / context.start[of_damping]  # both scales are logarithmic

    slopes = differentiate(loop, DifferencePoint(stretches, stretches.states, unit, start_std))
    kv, damping = (slopes.by_parameter[:, i] for i in (of_kv, of_damping))
    # One force: one-sided differences are 2 % apart
    assert np.abs(kv - share * damping).max() < 3e-4 * np.abs(kv).max()


@pytest.mark.slow
def test_intervals_hold_nine_times_of_ten(arm: Path, truth: Path, tmp_path: Path):
    seeds = range(12)
    worlds = [pseudo(arm, truth, tmp_path / f"{seed}", seed) for seed in seeds]
    errors = np.abs([errors_in_std(world, world.recordings) for world in worlds])
    assert 0.8 < (errors < 1.645).mean() <= 0.99


def test_a_jackknife_of_one_stretch_tells_nothing_and_of_two_what_they_disagree_by():
    """The last unknown has no prior, and is read in the last stretch alone."""
    prior = np.diag([1.0, 0.0])
    each = np.array([[[4.0, 0], [0, 0]], [[4.0, 0], [0, 2.0]]])
    slope = np.array([[2.0, 0], [-2.0, 0]])
    nothing = np.zeros((2, 0, 0))
    two = NormalEquations(nothing, nothing, np.zeros((2, 0)), each, slope)
    one = NormalEquations(*(part[1:] for part in two))
    np.testing.assert_array_equal(jackknife(*one.by_group(np.arange(1)), each[1] + prior), [0, 0])
    # Without either, the first moves by 2 / (4 + 1) to one side: √(1/2 · 2 · .4²) = .4
    unsure = stdtrit(1, 0.95) / ndtri(0.95)
    np.testing.assert_allclose(
        jackknife(*two.by_group(np.arange(2)), each.sum(0) + prior), [0.4 * unsure, 0], atol=1e-6
    )


def test_a_single_episode_is_as_unsure_as_leaving_out_its_parts_shows(
    arm: Path, truth: Path, tmp_path: Path
):
    """Compared with whole descents, each without a fifth of the rows, of an episode in whose middle
    the servos become others."""
    experiment, rng = pseudo(arm, truth, tmp_path / "run"), np.random.default_rng(0)
    context, (first, *_) = experiment.context, experiment.recordings
    assert isinstance(context.simulator, Simulator)
    real, see = experiment.space.from_dict(TRUTH), context.observation.observe_beside()
    others = real * [1.5 if name == "shoulder_kp" else 1.0 for name in experiment.space.names]
    one, other = first.actions[None, :30].astype(float), first.actions[None, 30:].astype(float)
    begun = context.simulator.roll_out(real[None], one, rng, see)
    ended = context.simulator.roll_out(others[None], other, rng, see, begun.states[:, -1])
    loop = set_up_loop(context.simulator, context.observation, context.start)
    readings = Readings.of([first], loop.sensors)
    readings.values[:] = np.concatenate([begun.observed, ended.observed[:, 1:]], 1)
    readings.values[:] += 0.002 * rng.normal(size=readings.values.shape)
    fit = OutputErrorMethod(loop, np.zeros(2, bool), experiment.space.to_unit(context.start))
    stage = ReplayStage(30)
    whole = fit.descend(readings, Guess(fit.prior, np.zeros(2)), stage, Budget())
    moved = []
    for part in np.array_split(np.arange(61), 5):
        values = readings.values.copy()
        values[:, part] = np.nan
        left = fit.descend(replace(readings, values=values), whole.guess, stage, Budget())
        moved.append(left.unit - whole.unit)
    claimed = np.sqrt(np.diag(fit.judge(whole, Budget()).covariance))
    # One Newton step instead of a descent; and no less than the residuals say
    ratio = claimed / jackknife_std(np.array(moved))
    assert ratio.min() > 0.6
    assert np.median(ratio) < 2.2


@pytest.mark.thorough
def test_an_offset_of_an_encoder_is_found_and_harms_nothing(arm: Path, truth: Path, tmp_path: Path):
    experiment = pseudo(arm, truth, tmp_path / "run")
    real = [
        replace(t, readings={"encoders": t.readings["encoders"] + [0.05, -0.03]})
        for t in experiment.recordings[:2]
    ]
    found = experiment.search.run_round(real, Budget()).estimate
    # Gravity tells the shoulder's true angle, by how far its servo sags
    assert found.offsets["elbow"] - found.offsets["shoulder"] == pytest.approx(-0.08, abs=0.02)
    assert np.abs(found.mean / experiment.space.from_dict(TRUTH) - 1).max() < 0.1


LATE = """
[[parameters]]
name = "delay"
kind = "delay"
objects = ["shoulder", "elbow"]
high = 0.5
"""


@pytest.mark.slow
def test_a_delay_that_nobody_declared_is_found_between_steps_too(truth: Path, tmp_path: Path):
    (tmp_path / "real").mkdir()
    late, its_truth = write_arm(tmp_path / "real", TUNE + LATE), tmp_path / "truth.json"
    its_truth.write_text(json.dumps({**TRUTH, "delay": 3.4 * 0.05}))
    real = pseudo(late, its_truth, tmp_path / "late").recordings
    experiment = pseudo(write_arm(tmp_path), truth, tmp_path / "run")
    observation = as_recorded(experiment)
    context = replace(experiment.context, observation=observation)
    found = type(experiment.search)(context).run_round(real, Budget()).estimate
    late_s = 0.05 * found.latency_steps + found.readings_late_s[0]
    assert late_s == pytest.approx(3.4 * 0.05, abs=1e-3)
    assert np.abs(found.mean / experiment.space.from_dict(TRUTH) - 1).max() < 0.05
    assert "What an action does shows in readings 170 ms later" in found.warnings[0]
    # And so it is replayed; without what is left of a step it would be ten times as far off
    left = [
        replay(context.simulator, observation, real, context.start, tuned)
        for tuned in (
            Tuned(found.mean, found.offsets, found.latency_steps, found.readings_late_s[0]),
            Tuned(found.mean, found.offsets, found.latency_steps),
        )
    ]
    of_late, of_others = (np.sqrt(np.nanmean((its.after - its.measured) ** 2)) for its in left)
    assert of_late < 0.0025
    assert of_others > 5 * of_late


@pytest.mark.thorough
def test_gaps_and_lost_packets_do_no_harm(arm: Path, truth: Path, tmp_path: Path):
    experiment, rng = pseudo(arm, truth, tmp_path / "run"), np.random.default_rng(0)
    real = []
    for trajectory in experiment.recordings[:2]:
        values = trajectory.readings["encoders"].copy()
        values[rng.random(values.shape) < 0.2] = np.nan
        values[rng.integers(len(values), size=2), 0] = 1.9  # nonsense
        real.append(replace(trajectory, readings={"encoders": values}))
    found = experiment.search.run_round(real, Budget()).estimate
    assert np.abs(found.mean / experiment.space.from_dict(TRUTH) - 1).max() < 0.15


@pytest.mark.thorough
def test_recordings_are_tuned_to_and_others_replayed(arm: Path, truth: Path, tmp_path: Path):
    for name, num, seed in (("some", 3, 0), ("others", 2, 1)):
        options = {"parameters": truth, "episodes": num, "seed": seed, "out": tmp_path / name}
        record(RecordConfig(task=str(arm), **options))
    run = tmp_path / "run"
    config = TuneConfig(task=str(arm), real=str(tmp_path / "some"), out=run, leave_out="2")
    result = tune(config)
    assert not result["stopped"].startswith("the time is over")
    score = evaluate(EvaluateConfig(run_folder=run, real=tmp_path / "others"))
    assert score["episodes"] == 2
    for joint in ("shoulder", "elbow"):
        its = score["sensors"][joint]
        assert its["unit"] == "rad"
        assert its["rms"] < 0.006 < its["rms_before"]
        assert its["better_in"] == 2
        assert its["rms_tuned_to"] == result["sensors"][joint]["rms"]
    assert score["far_off"] == score["no_offset"] == []
    assert_another_arm_is_noticed(run, tmp_path / "others")
    assert_nothing_is_compared_with_what_is_unknown(run, tmp_path / "others")
    assert_a_run_of_video_is_replayed(run, tmp_path / "others", score)
    assert (run / "replay.json").is_file()
    assert (run / "posterior.npz").is_file()
    assert not (run / "videos" / "real.mp4").exists()


def assert_another_arm_is_noticed(run: Path, recordings: Path) -> None:
    """One whose joints are wired to each other's columns."""
    (rows,) = (recordings / "data").rglob("*.parquet")
    original, table_ = rows.read_bytes(), pq.read_table(rows)
    place = table_.column_names.index("observation.state")
    values = np.array(table_["observation.state"].to_pylist(), np.float32)[:, ::-1]
    column = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), 2)
    pq.write_table(table_.set_column(place, "observation.state", column), rows)
    swapped = evaluate(EvaluateConfig(run_folder=run, real=recordings))
    assert set(swapped["far_off"]) == {"shoulder", "elbow"}
    assert any("of the same robot, with the same columns" in line for line in table(swapped))
    rows.write_bytes(original)


def assert_nothing_is_compared_with_what_is_unknown(run: Path, recordings: Path) -> None:
    """Such as what was left of readings that could never be compared."""
    known, result = (read_json(run / "result.json") for _ in range(2))
    result["sensors"]["elbow"]["rms"] = None
    write_json(run / "result.json", result)
    sensors = evaluate(EvaluateConfig(run_folder=run, real=recordings))["sensors"]
    assert "rms_tuned_to" not in sensors["elbow"]
    assert "rms_tuned_to" in sensors["shoulder"]
    write_json(run / "result.json", known)


def assert_a_run_of_video_is_replayed(run: Path, recordings: Path, score: dict[str, Any]) -> None:
    """By all sensors of the tuning file, whose offsets it does not know."""
    config, result = (read_json(run / f"{name}.json") for name in ("config", "result"))
    del result["sensors"]
    config["config"]["observe"] = "cameras"
    write_json(run / "result.json", result)
    write_json(run / "config.json", config)
    found = evaluate(EvaluateConfig(run_folder=run, real=recordings))
    assert found["far_off"] == []
    assert found["no_offset"] == ["shoulder", "elbow"]
    assert "no offset of shoulder, elbow: 0 is assumed" in table(found)[-1]
    for joint, its in found["sensors"].items():
        assert its["rms_before"] == score["sensors"][joint]["rms_before"]
        assert its["rms"] == pytest.approx(score["sensors"][joint]["rms"], abs=0.005)


SERVO = """
[[parameters]]
name = "elbow_lag"
kind = "lag"
objects = "elbow"
nominal = 0.05

[[parameters]]
name = "shoulder_limit"
kind = "torque_limit"
objects = "shoulder"
nominal = 15

[[parameters]]
name = "shoulder_delay"
kind = "delay"
objects = "shoulder"
nominal = 0.1
high = 0.5

[[parameters]]
name = "elbow_armature"
kind = "armature"
objects = "elbow"
"""
SERVO_TRUTH = {
    "elbow_lag": 0.12,
    "shoulder_limit": 9.0,
    "shoulder_delay": 0.23,
    "elbow_armature": 0.025,
}


@pytest.mark.slow
def test_what_servos_really_are_is_found_within_five_per_cent(tmp_path: Path):
    arm, truth = write_arm(tmp_path, HEAD + SERVO), tmp_path / "truth.json"
    truth.write_text(json.dumps(SERVO_TRUTH))
    experiment = pseudo(arm, truth, tmp_path / "run")
    found = experiment.search.run_round(experiment.recordings, Budget()).estimate
    real = experiment.space.from_dict(SERVO_TRUTH)
    assert np.abs(found.mean / real - 1).max() < 0.05


def test_an_episode_too_short_to_be_fitted_is_named():
    blank, name = np.zeros((21, 0, 0, 3), np.uint8), "at least 8 steps; episode 1, counted from 0, "
    whole = Trajectory(blank, np.zeros((20, 1), np.float32), 0.1)
    search, short = cast(ReadingsSearch, None), whole.first(5)
    with pytest.raises(InputError, match=name + "has 5"):
        ReadingsSearch.check(search, [whole, short, whole])
    with pytest.raises(InputError, match="at least 8 steps; swing3 has 5"):
        ReadingsSearch.check(search, [whole, short], ["swing2", "swing3"])


def test_a_run_without_readings_cannot_be_replayed(tmp_path: Path):
    (tmp_path / "config.json").write_text('{"config": {"task": "cartpole"}}')
    with pytest.raises(InputError, match=r"no joint readings to replay: .*\[\[sensors\]\]"):
        evaluate(EvaluateConfig(run_folder=tmp_path, real=tmp_path))


def test_a_replay_that_tuning_made_worse_is_said_to_be():
    better = {"unit": "rad", "rms_before": 0.2, "rms": 0.1, "better_in": 2}
    worse = {"unit": "rad", "rms_before": 0.1, "rms": 0.15, "better_in": 0}
    said = table({"sensors": {"hip": better, "knee": worse}, "episodes": 2})
    assert said[2].split() == ["hip", "0.2", "rad", "0.1", "rad", "-50", "%", "2", "of", "2"]
    assert said[-1].startswith("warning: after tuning, knee is further off than before")
    both = table({"sensors": {"toe": worse, "knee": worse}, "episodes": 2})
    assert both[-1].startswith("warning: after tuning, toe, knee are further off than before")
    falling = table({"sensors": {"knee": worse}, "episodes": 2, "astray": ["knee"]})
    assert not any("further off" in line for line in falling), "such replays say little"
    hardly = better | {"rms_before": 0.01, "rms": 0.0100001}
    said = table({"sensors": {"hip": hardly}, "episodes": 2})
    assert not any("further off" in line for line in said), "as in the report"
    alone = table({"sensors": {"hip": better}, "episodes": 2})
    assert not any("warning" in line for line in alone)


def test_far_more_left_than_of_what_was_tuned_to_is_said():
    its = {"unit": "m", "rms_before": 0.139, "rms_tuned_to": 0.0003, "better_in": 6}
    noise = {"x": 0.002, "y": 0.002}
    sensors = {"x": its | {"rms": 0.138}, "y": its | {"rms": 0.019}}
    assert far_off(sensors, noise) == ["x"]  # below ten times the sensor's noise is not far
    unknown = {name: {k: v for k, v in its.items() if k != "rms_tuned_to"} for name in sensors}
    assert far_off(unknown, noise) == []
    said = table({"sensors": sensors, "episodes": 6, "far_off": ["x"], "no_offset": []})
    assert said[-1].startswith("warning: far more is left than of the recordings")
    assert "(x: 0.138 m instead of 0.0003)" in said[-1]


def test_what_replays_do_not_tell_is_a_dash():
    """No number where a replay diverges, or where no reading can be compared."""
    lost = {"unit": "rad", "rms_before": None, "rms": 0.1, "better_in": 2, "diverged_before": 2}
    unknown = {"unit": "rad", "rms_before": 0.1, "rms": None, "better_in": 0, "rms_tuned_to": 0.1}
    assert far_off({"hip": lost | {"rms_tuned_to": None}, "knee": unknown}, {"hip": 1e-3}) == []
    head, _, hip, knee, *said = table({"sensors": {"hip": lost, "knee": unknown}, "episodes": 2})
    assert "before and after tuning" in head
    assert hip.split() == ["hip", "–", "0.1", "rad", "2", "of", "2"]
    assert knee.split() == ["knee", "0.1", "rad", "–", "0", "of", "2"]
    assert said == [
        "note: before tuning, the simulator diverges in every replay: nothing to compare"
    ]
    some = lost | {"rms_before": 0.01, "diverged_before": 1}
    said = table({"sensors": {"hip": some}, "episodes": 2})[3:]
    assert said == ["note: before tuning, the simulator diverges in 1 of 2 replays: not counted"]


def test_replays_that_are_off_by_more_than_readings_travel_are_noted():
    measured = np.zeros((2, 3, 3))
    measured[0, 1] = 0.1, 0.1, 0.0  # the last one is held still
    measured[1, 1:] = np.nan
    after = measured + np.array([1.0, 0.05, 0.05])
    names = "pitch", "wheel", "still"
    left = Replayed(names, ("rad",) * 3, np.zeros(3), 0.1, measured, after, after)
    assert astray(left, dict.fromkeys(names, 1e-3)) == ["pitch"]
    its = {"unit": "rad", "rms_before": 1.0, "rms": 1.0, "better_in": 0}
    said = table({"sensors": {"pitch": its}, "episodes": 2, "astray": ["pitch"]})
    assert said[-1].startswith("note: replays are off by more than the whole travel of pitch: ")


def test_readings_before_a_replay_begins_are_compared_with_nothing():
    measured, after = np.zeros((2, 4, 2)), np.zeros((2, 4, 2))
    measured[:, 1:, 1], after[:, :2] = np.nan, np.nan
    left = Replayed(("x", "y"), ("m", "m"), np.zeros(2), 0.1, measured, measured, after)
    assert only_early(left) == ["y"]
    after[1, 0, 1] = 0.0
    assert only_early(left) == []


def test_episodes_that_are_far_off_are_told_with_what_touches_in_them():
    off = np.zeros((2, 3, 2))
    off[1, :, 0], off[1, 2] = 0.05, np.nan  # a padded row
    left = Replayed(("x", "y"), ("m", "m"), np.zeros(2), 0.1, np.zeros((2, 3, 2)), off, off)
    its = {"unit": "m", "rms_before": 0.1, "rms": 0.04, "rms_tuned_to": 0.0003, "better_in": 0}
    sensors, noise = {"x": its, "y": its}, {"x": 0.002, "y": 0.002}
    assert far_episodes(left, ["x"], sensors, noise).tolist() == [False, True]
    assert not far_episodes(left, [], sensors, noise).any()
    unread = replace(left, after=np.where([[[True]], [[False]]], np.nan, left.after))
    assert far_episodes(unread, ["x"], sensors, noise).tolist() == [False, True]
    touching = "hand touches table in 1 of 1 episode: is it so on the robot?"
    result = {"sensors": sensors, "episodes": 2, "far_off": ["x"], "far_episodes": ["swing6"]}
    said = table(result | {"touching": touching})[-1]
    assert said.startswith("warning: far more is left in swing6 than of the recordings")
    assert f"In their replays {touching} If it is so, are these of the same robot" in said


def test_a_run_of_a_task_without_sensors_cannot_be_replayed(tmp_path: Path):
    tuning_file = write_arm(tmp_path, TUNE[: TUNE.index("[[sensors]]")] + SHOULDER)
    filmed = (
        (tmp_path / "arm.xml")
        .read_text()
        .replace("<worldbody>", '<worldbody><camera name="c" pos="0 -2 0"/>')
    )
    (tmp_path / "arm.xml").write_text(filmed)
    task = load_task(str(tuning_file))
    facts = {"nominal": 60.0, "initial": 60.0, "mean": 60.0}
    names = task.parameters.names
    result = {"task": "tune", "latency_steps": 0, "parameters": dict.fromkeys(names, facts)}
    config = {"task": str(tuning_file), "task_content": task.content_hash}
    (tmp_path / "config.json").write_text(json.dumps({"config": config}))
    (tmp_path / "result.json").write_text(json.dumps(result))
    with pytest.raises(InputError, match=r"no joint readings to replay: .*\[\[sensors\]\]"):
        evaluate(EvaluateConfig(run_folder=tmp_path, real=tmp_path))


def test_episodes_are_counted_in_which_less_is_left_after_tuning():
    measured = np.zeros((3, 4, 1))
    before, after = np.full_like(measured, 0.2), np.full_like(measured, 0.1)
    after[2] = 0.3
    measured[:, 1] = before[:, 1] = after[:, 1] = np.nan  # nothing was read
    replayed = Replayed(("knee",), ("rad",), np.zeros(1), 0.05, measured, before, after)
    assert better_in(replayed) == {"knee": 2}


def test_a_run_without_its_task_cannot_be_replayed(tmp_path: Path):
    facts = {"nominal": 1.0, "initial": 1.0, "mean": 1.0}
    result = {"task": "cartpole", "parameters": {"pole_mass": facts}, "sensors": {}}
    (tmp_path / "config.json").write_text('{"config": {"method": "autotune"}}')
    (tmp_path / "result.json").write_text(json.dumps(result))
    for real in (tmp_path, None):
        with pytest.raises(InputError, match=r"config\.json is damaged: its config has no task"):
            evaluate(EvaluateConfig(run_folder=tmp_path, real=real))


def test_what_cannot_be_observed_is_refused(arm: Path, truth: Path, tmp_path: Path):
    config = TuneConfig(task=str(arm), out=tmp_path / "run", observe="encoder")
    with pytest.raises(InputError, match=r"no sensor 'encoder' .* did you mean 'encoders'"):
        build_experiment(config)
    for sensors in ("encoders", None):
        sized = replace(config, observe=sensors, image_size=64)
        with pytest.raises(InputError, match=r"--image-size goes with pictures, and .* at none"):
            build_experiment(sized)
    colour = TUNE + '\n[[parameters]]\nname = "upper"\nkind = "light"\nobjects = "sun"\n'
    (tmp_path / "lit").mkdir()
    lit = write_arm(tmp_path / "lit", colour)
    mjcf = (lit.parent / "arm.xml").read_text()
    (lit.parent / "arm.xml").write_text(
        mjcf.replace("<worldbody>", '<worldbody><light name="sun" pos="0 0 1"/>')
    )
    with pytest.raises(InputError, match="shows in pictures only"):
        build_experiment(TuneConfig(task=str(lit), out=tmp_path / "run"))


def test_what_is_recorded_of_a_tuning_file_with_columns_is_read_by_it(tmp_path: Path):
    columns = '\n[actions]\ncolumns = ["one", "other"]\n'
    tuning_file = write_arm(tmp_path, TUNE.replace("\n[[sensors]]", columns + "\n[[sensors]]"))
    out = record(RecordConfig(task=str(tuning_file), out=tmp_path / "recordings", episodes=1))
    real = TuneConfig(task=str(tuning_file), real=str(out), out=tmp_path / "run")
    assert len(build_experiment(real).recordings) == 1


LIT = """
[[parameters]]
name = "sun"
kind = "light"
objects = "sun"
"""


@pytest.mark.thorough
def test_what_only_pictures_show_stays_unknown_where_nobody_looks_at_them(tmp_path: Path):
    tuning_file = write_arm(tmp_path, f'camera = "c"\n{TUNE}{LIT}')
    mjcf = tmp_path / "arm.xml"
    seen = (
        '<worldbody><light name="sun" pos="0 0 1"/><camera name="c" pos="0 -2 0" euler="1.57 0 0"/>'
    )
    mjcf.write_text(mjcf.read_text().replace("<worldbody>", seen))
    out = tmp_path / "run"
    config = TuneConfig(task=str(tuning_file), out=out, observe="joints", real_episodes=3)
    experiment = build_experiment(config)
    found = experiment.search.run_round(experiment.recordings, Budget()).estimate
    assert found.verdict == ["identified"] * 4 + ["not identifiable"]
    assert (found.low[4], found.high[4]) == (0.0, 1.0)


BOX = """
[[parameters]]
name = "box_mass"
kind = "mass"
objects = "box"
"""


def test_an_object_that_may_lie_anywhere_is_in_nobodys_way(tmp_path: Path):
    start = "\nbox = { position = [[0.4, 0.5], [-0.05, 0.05], [0.3, 0.4]] }\n\n[[sensors]]"
    tuning_file = write_arm(tmp_path, TUNE.replace("\n[[sensors]]", start) + BOX)
    mjcf = tmp_path / "arm.xml"
    box = (
        '<body name="box"><freejoint name="box"/><geom type="box" size=".1 .1 .1" mass="3"/></body>'
    )
    mjcf.write_text(mjcf.read_text().replace("</worldbody>", f"{box}</worldbody>"))
    context = build_experiment(TuneConfig(task=str(tuning_file), out=tmp_path / "run")).context
    loop = set_up_loop(context.simulator, context.observation, context.start)
    assert loop.physics.some_state[2] > 100  # m, and the arm is a metre long


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ('name = "joints"', "'joints' is what --observe calls all joints: choose another name"),
        ('joints = "wrist"', "no joint 'wrist' in the model; there are: shoulder, elbow"),
        ('joints = ["elbow", "elbow"]', "joints has elbow twice: name it once"),
        ('name = "left,right"', "--observe could not ask for 'left,right': leave commas out"),
        ('name = " arm"', "--observe could not ask for ' arm'"),
        ("behind_backlash = true", r"none of the joints has one: declare \[\[backlash\]\]"),
        ('unit = "mm"', "mm is no unit of shoulder"),
        ("noise = 0", "noise must be a finite number above 0, got 0"),
        ("latency_s = 2.0", "latency_s must be .* of at least 0 and at most 1, got 2"),
        ('columns = ["a", "b", "c"]', "expected 2 columns, one for each joint, .* got 3"),
        ('quantity = "current"', "'current'.*there are: position, velocity, torque"),
        ('quantities = "position"', "quantities"),
    ],
)
def test_a_wrong_sensor_is_told_with_its_line(line: str, complaint: str, tmp_path: Path):
    sensor = {"name": '"encoders"', "joints": '["shoulder", "elbow"]', "noise": "0.002"}
    key, _, value = line.partition(" = ")
    written = "\n".join(f"{k} = {v}" for k, v in (sensor | {key: value}).items())
    begin, end = TUNE.index('name = "encoders"'), TUNE.index("[[parameters]]")
    arm = write_arm(tmp_path, TUNE[:begin] + written + "\n\n" + TUNE[end:])
    with pytest.raises(InputError, match=rf"tune\.toml:\d+: .*{complaint}"):
        build_experiment(TuneConfig(task=str(arm), out=tmp_path / "run"))


def test_a_robot_of_which_only_velocities_are_read_is_replayed(truth: Path, tmp_path: Path):
    text = TUNE.replace("noise = 0.002", 'quantity = "velocity"')
    experiment = pseudo(write_arm(tmp_path, text), truth, tmp_path / "run")
    space, seen = experiment.space, experiment.context.observation
    tuned = Tuned(space.from_dict(TRUTH), {})
    found = replay(experiment.simulator, seen, experiment.recordings, space.nominal, tuned)
    assert np.isfinite(found.after).all()


def test_a_delay_in_steps_is_one_in_seconds_at_another_rate():
    result = {"latency_steps": 2, "readings_late_s": [0.004, 0.001]}
    run = cast(RunData, SimpleNamespace(result=result, replay={"step_s": 0.02}))
    assert _late(run, 0.02) == (2, 0.004)
    steps, late_s = _late(run, 0.04)
    assert (steps, late_s) == (1, pytest.approx(0.004))
    steps, late_s = _late(run, 0.1)
    assert (steps, late_s) == (0, pytest.approx(0.044))


def as_recorded(experiment: Experiment) -> ObservationModel:
    return replace(experiment.context.observation, is_simulated=False)


LATENCY = Latency()


def fit_of(
    experiment: Experiment,
    covariance: np.ndarray,
    apart: np.ndarray,
    observation: ObservationModel | None = None,
    noise: float = 0.001,
    unseen: tuple[str, ...] = (),
    unit: float = 0.5,
    is_sure: bool = True,
    by_timestep: float = 0.0,
    latency: Latency = LATENCY,
    lacked_time: bool = False,
) -> ReadingsResult:
    """From a fit in the middle of all ranges, or at another `unit` coordinate of all."""
    observation = observation or as_recorded(experiment)
    facts = {"covariance": covariance, "unit": np.full(len(apart), unit), "late_steps": (0.0, 0.0)}
    facts |= {"offsets": np.zeros(2), "noise": np.full(2, noise), "start": np.zeros(1)}
    facts["shares"] = np.tile(0.5, (len(apart), 2))
    facts |= {"by_timestep": np.full(len(apart), by_timestep), "timestep_s": 0.002}
    judged = cast(OutputErrorFit, SimpleNamespace(**facts))
    ended = {"apart": apart, "is_sure": is_sure, "is_whole": True, "num_fits": 2}
    found = cast(BestDescent, SimpleNamespace(**ended, lacked_time=lacked_time))
    first = Distribution.first(experiment.space, experiment.space.nominal)
    return conclude(judged, found, first, observation, latency, 0.05, Unmeasured(unseen))


def test_intervals_count_what_the_timestep_changes(tmp_path: Path):
    experiment = pseudo(write_arm(tmp_path), None, tmp_path / "run")
    fit = 0.01**2 * np.eye(len(experiment.space)), np.zeros(len(experiment.space))

    def found(by_timestep: float, **facts: Any) -> tuple[np.ndarray, list[str]]:
        estimate = fit_of(experiment, *fit, by_timestep=by_timestep, **facts).estimate
        ends = map(experiment.space.to_unit, (estimate.low, estimate.high))
        return np.diff([*ends], axis=0)[0] / 2, estimate.warnings

    (narrow, nothing), (wide, (told,)) = found(0.0), found(-0.05)
    rest = (0.01**2 + 0.005**2) ** 0.5  # of the fit, and of any model
    np.testing.assert_allclose(narrow, 1.645 * rest, rtol=0.02)
    np.testing.assert_allclose(wide, 1.645 * np.hypot(rest, 0.05), rtol=0.02)
    assert nothing == found(-0.01)[1] == []
    assert "timestep of 2 ms" in told
    assert not any("timestep" in warning for warning in found(-0.05, unseen=("torso",))[1])


def test_what_readings_show_that_no_setting_explains_is_not_called_identified(tmp_path: Path):
    """An elbow rubs by 1 N m, and the model says .2: its gain comes out a tenth too low."""
    (tmp_path / "real").mkdir()
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps({**TRUTH, "elbow_friction": 1.0}))
    real = pseudo(write_arm(tmp_path / "real"), truth, tmp_path / "rubbing").recordings
    gains = TUNE[: TUNE.index('[[parameters]]\nname = "elbow_friction"')]
    experiment = pseudo(write_arm(tmp_path, gains), None, tmp_path / "run")
    found = experiment.search.run_round(real, Budget()).estimate
    verdicts = dict(zip(experiment.space.names, found.verdict, strict=True))
    assert verdicts == {
        "shoulder_kp": "identified",
        "shoulder_kv": "identified",
        "elbow_kp": "weak",
    }
    assert "leaves elbow off by over four times" in found.warnings[-1]
    assert not found.low[-1] < TRUTH["elbow_kp"] < found.high[-1]  # sure and wrong otherwise


@pytest.mark.parametrize("by_timestep", [0.0, 0.01])
def test_errors_that_are_added_to_a_fits_thin_its_correlations_out(
    truth: Path, tmp_path: Path, by_timestep: float
):
    """Two that are told well together only: what no fit can detect is not common to them.

    What the timestep does is: it moves them together.
    """
    experiment = pseudo(write_arm(tmp_path), truth, tmp_path / "run")
    num = len(TRUTH)
    covariance = 1e-4 * (0.99 * np.ones((num, num)) + 0.01 * np.eye(num))
    apart = np.array([0.003, -0.003, 0.0, 0.0])
    estimate = fit_of(experiment, covariance, apart, by_timestep=by_timestep).estimate
    observation = as_recorded(experiment)
    discrepancy = observation.discrepancy_std(np.zeros(num, bool))[0]
    # A fit's prior, .3, is taken out, and replaced by that of what nothing shows
    given = np.linalg.inv(covariance + np.outer(apart, apart)) + (1 - 0.3**-2) * np.eye(num)
    total = np.linalg.inv(given) + discrepancy**2 * np.eye(num) + by_timestep**2
    std = np.sqrt(np.diag(total))
    np.testing.assert_allclose(estimate.correlation, total / np.outer(std, std), rtol=1e-3)


def test_what_is_far_off_is_told_also_where_no_noise_is_declared(truth: Path, tmp_path: Path):
    experiment, num = pseudo(write_arm(tmp_path), truth, tmp_path / "run"), len(TRUTH)
    sensor, *_ = as_recorded(experiment).sensors
    for noise, said in ((0.001, "noise that the tuning file declares"), (None, "declares none")):
        observation = replace(as_recorded(experiment), sensors=(replace(sensor, noise=noise),))
        for off, expected in ((0.003, []), (0.005, [said])):
            found = fit_of(experiment, np.eye(num), np.zeros(num), observation, off).estimate
            told = [
                warning for warning in found.warnings if "leaves shoulder, elbow off" in warning
            ]
            assert len(told) == len(expected)
            assert all(said in warning for warning in told)
            sure = 1e-4 * np.eye(num), np.zeros(num)
            verdict = fit_of(experiment, *sure, observation, off).estimate.verdict
            assert verdict == ["weak" if expected else "identified"] * num


def test_readings_of_a_robot_that_begins_unseen_identify_nothing(truth: Path, tmp_path: Path):
    experiment, num = pseudo(write_arm(tmp_path), truth, tmp_path / "run"), len(TRUTH)
    known = 1e-4 * np.eye(num), np.zeros(num)
    seen, unseen = (fit_of(experiment, *known, unseen=names) for names in ((), ("torso",)))
    assert (seen.is_trusted, unseen.is_trusted) == (True, False)
    assert (seen.estimate.verdict, seen.estimate.warnings) == (["identified"] * num, [])
    assert unseen.estimate.verdict == ["weak"] * num
    (warning,) = unseen.estimate.warnings
    assert warning.startswith("Where torso begins no sensor measures")


def test_of_a_delay_that_was_not_looked_for_to_the_end_nothing_is_identified(truth, tmp_path):
    experiment, num = pseudo(write_arm(tmp_path), truth, tmp_path / "run"), len(TRUTH)
    cut_off = fit_of(experiment, 1e-4 * np.eye(num), np.zeros(num), latency=Latency(1, False))
    assert cut_off.estimate.verdict == ["weak"] * num
    assert not cut_off.is_in_time
    found, doubt = cut_off.estimate.warnings
    assert found.startswith("The actions seem to take effect 1 step later")
    assert doubt.startswith("There was no time to look for a longer delay")


@pytest.mark.parametrize(
    ("facts", "std", "precision", "reason"),
    [
        ({}, 0.01, 0.01, "another round would tell hardly more"),
        ({}, 0.01, 10.0, "every parameter is known to 1000 %"),
        ({}, 0.01, 0.0, "another round would tell hardly more"),  # 0 % asks for all, and this is
        ({"latency": Latency(1, False)}, 0.01, 10.0, ""),
        ({"is_sure": False, "lacked_time": True}, 0.01, 10.0, ""),
        ({"is_sure": False}, 0.01, 10.0, "another round would tell hardly more"),
    ],
)
def test_a_search_of_readings_is_over_only_if_no_time_was_lacking(
    truth, tmp_path, monkeypatch, facts, std, precision, reason
):
    """Its warnings ask for more minutes else, and the same command must be able to use them."""
    experiment, num = pseudo(write_arm(tmp_path), truth, tmp_path / "run"), len(TRUTH)
    fit = fit_of(experiment, std**2 * np.eye(num), np.zeros(num), **facts)
    monkeypatch.setattr(ReadingsSearch, "fit", lambda *_: fit)
    search = ReadingsSearch(experiment.context, precision)
    estimate = search.run_round(experiment.recordings, Budget()).estimate
    assert search.stop_reason == reason
    assert any("more minutes" in warning for warning in estimate.warnings) == (not reason)


def test_where_a_robot_begins_unseen_no_more_minutes_or_bounds_are_advised(
    truth: Path, tmp_path: Path
):
    experiment, num = pseudo(write_arm(tmp_path), truth, tmp_path / "run"), len(TRUTH)
    fit = 1e-4 * np.eye(num), np.zeros(num)
    at_bound = {"unit": 1.0, "is_sure": False}
    seen = fit_of(experiment, *fit, **at_bound).estimate.warnings
    assert sum("wider low and high" in warning for warning in seen) == num
    (twice,) = (warning for warning in seen if "ended at no answer twice" in warning)
    assert "minutes" not in twice, "all fits were made"
    hurried = fit_of(experiment, *fit, **at_bound, lacked_time=True).estimate.warnings
    assert any("or more minutes" in warning for warning in hurried)
    first, *others = fit_of(experiment, *fit, unseen=("torso",), **at_bound).estimate.warnings
    assert first.startswith("Where torso begins no sensor measures")
    assert "by a keyframe" in first
    (bounds,) = others
    assert "elbow_friction ended at a bound" in bounds
    assert "wider bounds would not help" in bounds


def test_where_nearly_nothing_is_explained_no_wider_bounds_are_advised(truth: Path, tmp_path: Path):
    experiment, num = pseudo(write_arm(tmp_path), truth, tmp_path / "run"), len(TRUTH)
    fit = 1e-4 * np.eye(num), np.zeros(num)
    off, bounds = fit_of(experiment, *fit, noise=0.02, unit=1.0).estimate.warnings
    assert "off by over four times the noise that the tuning file declares" in off
    assert "wider bounds would not help" in bounds


def test_of_two_that_act_as_one_neither_is_known(truth: Path, tmp_path: Path):
    """Their sum is told to .002; the fit's prior of either says nothing of the other."""
    experiment, num = pseudo(write_arm(tmp_path), truth, tmp_path / "run"), len(TRUTH)
    together, alone = np.array([1.0, 1.0, 0, 0]) / np.sqrt(2), np.diag([0, 0, 1.0, 1.0])
    told = np.outer(together, together) / 0.002**2 + alone / 0.01**2
    covariance = np.linalg.inv(told + np.eye(num) / 0.3**2)
    found = fit_of(experiment, covariance, np.zeros(num)).estimate
    assert found.verdict == [*(["not identifiable"] * 2), *(["identified"] * 2)]
    assert found.correlation is not None
    assert found.correlation[0, 1] < -0.99


def test_of_two_that_add_up_the_larger_may_be_less_by_all_that_the_smaller_may_be_more():
    """A servo's kv of 3 and a joint's damping of .5, of which only the sum is known well."""
    dampings = [
        dynamics("kv", "actuator_gainprm", ("m",), nominal=3.0, unit="N m s"),
        dynamics("damping", "dof_damping", ("j",), nominal=0.5, unit="N m s"),
    ]
    space, std = ParameterSpace(dampings), 0.12
    unit = space.to_unit(space.nominal)
    # One log unit of either is as many unit coordinates; the sum's slopes by them are 3 and .5
    along = np.array([-0.5, 3.0]) / np.hypot(0.5, 3.0)
    covariance = std**2 * np.outer(along, along) + 1e-8 * np.eye(2)
    of_kv, of_damping = np.sqrt(np.diag(covariance))
    wider = _along_sums(space, unit, np.arange(2), covariance)
    end = space.from_unit(unit + 1.645 * np.array([-wider[0] * of_kv, wider[1] * of_damping]))
    assert wider[1] == pytest.approx(1.0)
    assert wider[0] > 1.3
    assert end.sum() == pytest.approx(3.5, rel=1e-3)
    # On linear scales nothing bends, whatever else is hardly known, and also at a bound
    masses = [replace(p, scale="linear", low=1.0, high=3.0, nominal=2.0) for p in dampings]
    masses = ParameterSpace([*masses, replace(masses[0], name="third")])
    turn = np.array([[0.8, -0.48, 0.36], [0.6, 0.64, -0.48], [0.0, 0.6, 0.8]])
    for at in (np.full(3, 0.5), np.array([1.0, 0.5, 0.5])):
        linear = turn @ np.diag(np.square([0.3, 0.11, 0.005])) @ turn.T
        assert _along_sums(masses, at, np.arange(3), linear) == pytest.approx(np.ones(3), rel=0.01)
    # Known well, nothing bends
    assert _along_sums(space, unit, np.arange(2), covariance / 4) == pytest.approx([1.0, 1.0])


def test_what_readings_say_nothing_of_is_as_wide_as_its_range(truth: Path, tmp_path: Path):
    """The fit's prior, a standard deviation of .3, is no knowledge."""
    experiment, num = pseudo(write_arm(tmp_path), truth, tmp_path / "run"), len(TRUTH)
    nothing = fit_of(experiment, 0.3**2 * np.eye(num), np.zeros(num)).estimate
    assert nothing.verdict == ["not identifiable"] * num
    little = fit_of(experiment, 0.15**2 * np.eye(num), np.zeros(num)).estimate
    much = fit_of(experiment, 0.02**2 * np.eye(num), np.zeros(num)).estimate
    space = experiment.space
    stds = [np.ptp([space.to_unit(e.low), space.to_unit(e.high)], 0) / 3.29 for e in (little, much)]
    by_data = [1 / np.sqrt(std**-2 - 0.3**-2) for std in (0.15, 0.02)]
    np.testing.assert_allclose(stds[0], by_data[0], rtol=0.03)
    np.testing.assert_allclose(stds[1], np.hypot(by_data[1], 0.005), rtol=0.03)
