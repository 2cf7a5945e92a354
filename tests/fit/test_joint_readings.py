"""Joint readings as evidence, and what encoders show more than the truth beside pictures."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from servo_arm import write_arm
from test_fit import MOVING, SPACE, observed_of, rough_states, simulator  # noqa: F401

from simtune.errors import InputError
from simtune.fit import Observed, Physics
from simtune.fit.motion.offsets import has_unknown_offsets, loosened, without_offsets
from simtune.fit.motion.shooting import Shooting
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.fit.readings.measured_states import MeasuredStates
from simtune.fit.readings.normal_equations import explained_by_starts
from simtune.fit.readings.residuals import correlation_times, spread
from simtune.fit.readings.slopes import Groups, StretchSlopes, agreed
from simtune.observation import (
    AllEvidence,
    JointReadings,
    JointSensor,
    ObservationModel,
    advanced,
    declared_noise,
)
from simtune.randomization import Distribution
from simtune.real.recorded import RecordedReal, read_episode
from simtune.recordings import Dataset, open_dataset
from simtune.recordings.resample import counted_on
from simtune.simulation import random_actions
from simtune.tasks import load_task
from simtune.vision.keypoints import find_keypoints


def sensor_of(**changed) -> JointSensor:
    usual = {"name": "encoders", "columns": ("a", "b"), "joints": ("a", "b")}
    usual |= {"places": np.array([0, 1]), "factor": np.ones(2), "shift": np.zeros(2)}
    return JointSensor(**(usual | changed))


def test_readings_are_brought_to_units_and_to_the_frames_moments():
    sensor = sensor_of(
        factor=np.full(2, 180 / np.pi),
        shift=np.array([10.0, 0.0]),
        offset=np.full(2, 0.1),
        latency_s=0.05,
    )
    angles = np.arange(4.0)[:, None] + np.array([0.0, 1.0])
    recorded = np.degrees(angles) + np.array([10.0, 0.0])
    readings = sensor.from_recorded(recorded, step_s=0.1)
    # Half a step later, less the offset; of the last frame nothing is known yet
    np.testing.assert_allclose(readings[:3, 0], [0.4, 1.4, 2.4])
    np.testing.assert_allclose(readings[:3, 1], [1.4, 2.4, 3.4])
    assert np.isnan(readings[3]).all()
    there = sensor_of(factor=np.full(2, 2.0), shift=np.ones(2), offset=np.array([0.1, 0.2]))
    values = np.array([[0.3, 0.4]])
    np.testing.assert_allclose(there.from_recorded(there.to_recorded(values), 0.1), values)


def test_backlash_adds_to_the_readings_behind_it_alone():
    class Batch:
        qpos = np.array([[1.0, 2.0, 0.1, np.nan]])

    sensor = sensor_of(geared=np.array([1]), play_places=np.array([2]))
    np.testing.assert_allclose(sensor.observe(Batch), [[1.0, 2.1]])
    np.testing.assert_array_equal(Batch.qpos, [[1.0, 2.0, 0.1, np.nan]])


def test_what_is_late_is_read_off_a_curve_but_not_in_gaps():
    turn = np.sin(0.3 * np.arange(20.0))
    gap = np.where(np.arange(20) == 9, np.nan, turn)
    later, expected = advanced(np.stack([turn, gap], -1), 0.4), np.sin(0.3 * np.arange(0.4, 20))
    np.testing.assert_allclose(later[:19, 0], expected[:19], atol=1e-4)
    assert np.isnan(later[-1]).all()
    assert np.flatnonzero(np.isnan(later[:, 1])).tolist() == [9, 19]
    np.testing.assert_allclose(np.delete(later[:19, 1], 9), np.delete(expected[:19], 9), atol=1e-3)
    long = np.where(np.isin(np.arange(20), [8, 9, 10]), np.nan, turn)
    (missing,) = np.nonzero(np.isnan(advanced(long[:, None], 0.4)[:, 0]))
    assert missing.tolist() == [7, 8, 9, 10, 19]


@pytest.mark.parametrize("late", [1e-9, 0.1, 0.5, 1.7])
@pytest.mark.parametrize("every", [2, 3, 8])
def test_a_late_encoder_slower_than_rows_has_as_many_readings_as_before(every, late):
    slow = np.full(81, np.nan)
    slow[::every] = np.sin(0.1 * np.arange(0, 81, every))
    later = advanced(slow[:, None], late)[:, 0]
    (rows,) = np.nonzero(np.isfinite(later))
    assert len(rows) in (np.isfinite(slow).sum() - 1, np.isfinite(slow).sum())
    assert (np.diff(rows) == every).all()
    np.testing.assert_allclose(later[rows], np.sin(0.1 * (rows + late)), atol=2e-3)


def test_readings_late_by_whole_rows_are_only_moved():
    recorded = np.random.default_rng(0).normal(size=(30, 2))
    recorded[[4, 5, 6, 7, 20], 0] = np.nan
    later = sensor_of(latency_s=0.06).from_recorded(recorded, 0.02)
    expected = np.pad(recorded[3:], ((0, 3), (0, 0)), constant_values=np.nan)
    np.testing.assert_array_equal(later, expected)


def test_an_episode_no_longer_than_a_sensors_latency_is_refused_by_name():
    sensor = sensor_of(latency_s=0.5)
    with pytest.raises(InputError, match=r"sensor encoders: no reading of a is left of 4 rows"):
        sensor.from_recorded(np.zeros((4, 2)), step_s=0.1)
    assert np.isnan(sensor.from_recorded(np.full((4, 2), np.nan), step_s=0.1)).all()


def test_student_weights_and_gaps_by_hand():
    values = np.array([[[0.0, np.nan]], [[0.2, 1.0]]])
    evidence = JointReadings.of("encoders", "rad", values, noise=0.1)
    residuals, weights = evidence.linearize(np.full((2, 1, 2), 0.1))
    np.testing.assert_allclose(residuals[:, 0, 0], [1.0, -1.0])
    np.testing.assert_allclose(weights[:, 0, 0], 5 / (4 + 1))
    assert residuals[0, 0, 1] == weights[0, 0, 1] == 0
    likelihood = evidence.log_likelihood(np.full((2, 1, 2), 0.1))
    np.testing.assert_allclose(likelihood[0], -2.5 * np.log(1.25))
    assert evidence.typical_distance(np.full((2, 1, 2), 0.1)) == pytest.approx(0.1)


def test_a_column_without_a_reading_has_a_scale_and_no_warning():
    values = np.stack([np.arange(4.0), np.full(4, np.nan)], -1)[None]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        evidence = JointReadings.of("encoders", "rad", values, noise=0.1)
    np.testing.assert_allclose(evidence.features[0, :, 0].std(), 1.0)
    assert np.isnan(evidence.features[..., 1]).all()  # not the mean, which is no measurement
    assert evidence.spread[1] == 0.1


def test_what_two_sensors_measure_is_told_apart_by_name():
    one, other = sensor_of(), sensor_of(name="second", joints=("b", "c"))
    model = ObservationModel.of_simulator((one, other))
    assert model.reading_labels == ("a", "encoders/b", "second/b", "c")
    assert model.only(("joints",)).cameras == ()
    assert model.only(("cameras", "second")).reading_labels == ("b", "c")


def test_white_noise_counts_fully_and_a_slow_residual_once_in_its_time():
    rng = np.random.default_rng(0)
    white, slow = rng.normal(size=(20, 400)), np.zeros((20, 400))
    for t in range(1, 400):
        slow[:, t] = 0.9 * slow[:, t - 1] + rng.normal(size=20)
    times = correlation_times(np.stack([white, slow], -1))
    assert times[0] < 1.3
    assert times[1] == pytest.approx((1 + 0.9) / (1 - 0.9), rel=0.2)  # of a first-order process


@pytest.mark.parametrize("every", [3, 4, 8])
def test_rows_without_readings_do_not_hide_how_long_a_residual_lasts(every):
    rng, slow = np.random.default_rng(0), np.zeros((20, 600, 2))
    for t in range(1, 600):
        slow[:, t] = 0.97 * slow[:, t - 1] + rng.normal(size=(20, 2))
    read = np.full_like(slow, np.nan)
    read[:, ::every, 0] = slow[:, ::every, 0]
    read[..., 1] = np.where(rng.random((20, 600)) < 0.95, slow[..., 1], np.nan)
    alone = correlation_times(slow[:, ::every])[0], correlation_times(slow)[1]
    np.testing.assert_allclose(correlation_times(read), alone, rtol=0.1)


def test_a_reading_that_is_never_there_leaves_the_noise_of_the_others():
    residuals = np.stack([np.tile([1.0, -1.0], (3, 2)), np.full((3, 4), np.nan)], -1)
    np.testing.assert_allclose(spread(residuals, np.array([9.0, 0.1])), [1.0, 0.1], rtol=1e-5)


def test_what_initial_states_explain_is_missing_from_residuals():
    """Of a line through 5 readings, with an unknown height and slope, 3 are left; of another, 5."""
    rng, rows = np.random.default_rng(0), np.linspace(-1, 1, 5)
    line = 100 * np.stack([np.ones(5), rows])
    by_start = np.tile(np.stack([line, 0 * line], -1), (400, 1, 1, 1))
    noise = rng.normal(size=(400, 5, 2))
    fitted = line.T @ np.linalg.pinv(line.T)
    left = np.stack([noise[..., 0] - noise[..., 0] @ fitted, noise[..., 1]], -1)
    spent = explained_by_starts(by_start, left, np.ones(2))
    np.testing.assert_allclose(spent, [800, 0], rtol=1e-3)
    unbiased = np.square(left).sum((0, 1)) / (2000 - spent)
    np.testing.assert_allclose(unbiased, 1.0, atol=0.1)


def test_unknowns_that_share_no_reading_are_derived_by_at_once():
    # Four parameters of two readings; the fourth hardly shows, and only where the first does more
    effects = np.array([[1.0, 0.02], [0.9, 0.0], [0.0, 1.0], [0.0, 0.01]])
    by_parameter = np.broadcast_to(effects[None, :, None, :], (3, 4, 5, 2))
    slopes = StretchSlopes(np.zeros((3, 5, 2)), by_parameter, np.zeros((3, 0, 5, 2)))
    groups = Groups.of(slopes, np.ones(2))
    assert groups.number[0] == groups.number[2] != groups.number[1]
    its_group = groups.owner[groups.number[3]]
    assert its_group[1] == 3  # not who has a larger side effect there
    assert groups.owner[groups.number[0]].tolist() == [0, 2]


def test_what_no_reading_tells_of_waits():
    # A parameter that shows and one that does not; a start that is forgotten and one that grows
    by_parameter, by_start = np.array([[0.5, 0.0], [0.0, 1e-3]]), np.array([[0.9, 2.9], [0.0, 3.1]])
    spread = [np.broadcast_to(its[None, :, None], (3, 2, 5, 2)) for its in (by_parameter, by_start)]
    groups = Groups.of(StretchSlopes(np.zeros((3, 5, 2)), *spread), np.ones(2))
    assert groups.number.tolist() == [0, -1, -1, 0]
    assert groups.owner.tolist() == [[0, 3]]
    still = Groups.of(
        StretchSlopes(np.zeros((3, 5, 2)), *(1e-3 * its for its in spread)), np.ones(2)
    )
    assert still.number.tolist() == [-1] * 4
    assert still.owner.shape == (0, 2)


@pytest.mark.thorough
def test_an_encoders_offset_is_found_by_what_pictures_show(simulator):  # noqa: F811
    rng, noise = np.random.default_rng(0), 0.002
    keypoints = find_keypoints(simulator, Distribution.first(SPACE, SPACE.nominal), 0)
    sensor = sensor_of(joints=("slider", "hinge_1"), noise=noise)
    see = ObservationModel.of_simulator((sensor,)).observe_beside(keypoints.observe)
    actions = random_actions(3, 60, simulator.action_mapping, rng)
    worlds = np.repeat(SPACE.nominal[None], 3, 0)
    rollouts = simulator.roll_out(worlds, actions, rng, see)
    seen = rollouts.observed
    of_pictures = type(rollouts)(**{**vars(rollouts), "observed": seen[..., :-2]})
    tracks = observed_of(of_pictures, 0.3, 0.0, rng).evidence.parts[0]
    shown = seen[..., -2:] + [0.02, -0.06] + noise * rng.normal(size=seen[..., -2:].shape)
    both = AllEvidence((tracks, sensor.evidence(shown)))
    observed = Observed(both, rollouts.actions.astype(float))
    assert has_unknown_offsets(observed)
    physics = Physics(simulator, see, rollouts.states[0, 0])
    config = ShootingConfig(stages=(Stage(4, 3, 3.0), Stage(8, 3)), num_windows=24)
    shooting = Shooting(physics, np.array([0.1, 0.1, 0.5, 0.5]), MOVING, config)
    fit = shooting.fit(loosened(observed), rough_states(rollouts, rng), SPACE.nominal)
    corrected, offsets = without_offsets(observed, physics, fit, SPACE.nominal)
    np.testing.assert_allclose(offsets, [0.02, -0.06], atol=0.006)
    left = corrected.evidence.parts[1].typical_distance(seen[..., -2:])
    assert left < 3 * noise


def test_of_two_encoders_of_a_joint_the_last_one_corrects_it(simulator):  # noqa: F811
    """On the motor and behind its gears: both say how far a replay is off, it is moved once."""
    motors = sensor_of(joints=("slider", "hinge_1"))
    one = {"columns": ("c",), "places": np.array([1]), "factor": np.ones(1), "shift": np.zeros(1)}
    link = sensor_of(name="link", joints=("hinge_1",), **one)
    observe = ObservationModel.of_simulator((motors, link)).observe_beside()
    start = simulator.begin(SPACE.nominal[None], np.random.default_rng(0)).states[0, 0]
    measured = MeasuredStates(Physics(simulator, observe, start), (motors, link))
    states = np.ones((1, 2, simulator.model.nq + simulator.model.nv))
    change = np.tile([0.01, 0.02, 0.03], (1, 2, 1))
    moved = measured.corrected(states, change, 0.1 * change) - 1
    nq, step_s = simulator.model.nq, simulator.step_s
    np.testing.assert_allclose(moved[..., [0, 1]], [[[0.01, 0.03]] * 2], atol=1e-12)
    speeds = [[[0.001 / step_s, 0.003 / step_s]] * 2]
    np.testing.assert_allclose(moved[..., [nq, nq + 1]], speeds, atol=1e-12)
    assert (states == 1).all()


def test_a_change_counts_by_how_well_another_one_agrees():
    rng = np.random.default_rng(0)
    smooth = np.ones((1, 1, 200, 2))
    np.testing.assert_allclose(agreed(smooth, 1.05 * smooth), 1.025, rtol=2e-3)
    # Noise of the world in the middle, the end of one change and the start of the other
    first, middle, last = 100 * rng.normal(size=(3, *smooth.shape))
    left = agreed(smooth + middle - first, smooth + last - middle)
    assert np.sqrt(np.square(left).mean()) < 0.2 * 100


def test_a_gain_says_what_a_recorded_number_is(tmp_path):
    toml = write_arm(tmp_path)
    text = toml.read_text()
    toml.write_text(text.replace("noise = 0.002", "gain = [0.01, -0.02]\nnoise = 1"))
    (sensor,) = load_task(str(toml)).sensors
    np.testing.assert_allclose(sensor.from_recorded(np.full((2, 2), 50.0), 0.1), [[0.5, -1]] * 2)
    np.testing.assert_allclose(sensor.noise, [0.01, 0.02])  # each joint's own
    np.testing.assert_allclose(declared_noise([sensor]), [0.01, 0.02])
    noisy = sensor.measure(np.zeros((4000, 2)), np.random.default_rng(0))
    np.testing.assert_allclose(noisy.std(0), [0.01, 0.02], rtol=0.05)
    evidence = sensor.evidence(np.zeros((1, 5, 2)))
    off, _ = evidence.linearize(np.full((1, 5, 2), 0.02))
    np.testing.assert_allclose(off[0, 0], [2, 1])
    for wrong in ("gain = [1, 2, 3]", "gain = 0", 'gain = 1\nunit = "deg"', "gain = [[1], [1, 2]]"):
        toml.write_text(text.replace("noise = 0.002", wrong))
        with pytest.raises(InputError, match=r"tune.toml:1.*gain"):
            load_task(str(toml))


@pytest.mark.parametrize(("unit", "low", "high"), [("percent", 0, 100), ("-100..100", -100, 100)])
def test_shares_of_a_joints_range(tmp_path, unit, low, high):
    """The arm's joints go from -2 to 2 rad."""
    toml = write_arm(tmp_path)
    toml.write_text(toml.read_text().replace("noise = 0.002", f'unit = "{unit}"\nnoise = 1'))
    (sensor,) = load_task(str(toml)).sensors
    recorded = np.array([[low, high], [(low + high) / 2, low]], float)
    np.testing.assert_allclose(sensor.from_recorded(recorded, 0.1), [[-2, 2], [0, -2]], atol=1e-12)
    assert sensor.noise == pytest.approx(4 / (high - low))
    toml.write_text(toml.read_text().replace("noise = 1", 'quantity = "velocity"'))
    with pytest.raises(InputError, match=f"tune.toml:1.*: {unit} is of a joint's range"):
        load_task(str(toml))


def test_angles_that_begin_again_after_a_turn_are_counted_on():
    """But not those that are counted on already, where a turn within a step is a fast wheel."""
    true = np.stack([np.linspace(3, 8, 30), np.linspace(0, 40 * np.pi, 30)], 1)
    recorded = np.stack([(true[:, 0] + np.pi) % (2 * np.pi) - np.pi, true[:, 1]], 1)
    recorded[4, 0] = np.nan
    read = counted_on(recorded, sensor_of(endless=np.array([True, True])).periods)
    np.testing.assert_allclose(np.delete(read, 4, 0), np.delete(true, 4, 0), atol=1e-12)
    assert np.isnan(read[4, 0])
    as_it_is = counted_on(recorded, sensor_of(endless=np.array([False, True])).periods)
    np.testing.assert_allclose(as_it_is, recorded)
    np.testing.assert_array_equal(counted_on(recorded, sensor_of().periods), recorded)


@pytest.mark.parametrize("lost", [100.0, -7.0])
def test_a_lost_packet_does_not_keep_turns_from_being_counted(lost):
    true = 4 * 0.05 * np.arange(100)
    recorded = (true + np.pi) % (2 * np.pi) - np.pi
    recorded[57] = lost
    counted = counted_on(recorded[:, None], np.array([2 * np.pi]))[:, 0]
    np.testing.assert_allclose(np.delete(counted, 57), np.delete(true, 57), atol=1e-12)
    assert counted[57] == lost
    recorded[[20, 40]] = 100.0, -100.0  # too many to be lost packets
    np.testing.assert_array_equal(
        counted_on(recorded[:, None], np.array([2 * np.pi]))[:, 0], recorded
    )


def recorded_at_50_hz(folder: Path, values: np.ndarray, control_hz: float) -> Dataset:
    """An episode of (T, 2) recorded numbers, to be read at another rate."""
    actions = np.zeros((len(values) - 1, 1))
    np.savez(folder / "turns.npz", hz=50, actions=actions, encoders=values)
    columns = {"encoders": ["encoders"]}
    return open_dataset(folder, cameras=(), readings=columns, control_hz=control_hz)


def test_encoders_that_begin_again_are_counted_on_before_they_are_read_at_another_rate(tmp_path):
    """One in degrees from 0 to 360, the other way round, and a limited joint that jumps."""
    times_s = np.arange(201) / 50
    turned = np.stack([0.3 + 12 * times_s + 0.5 * np.sin(2 * times_s)] * 2, 1)
    turned[:, 1] = 2.5 * np.sign(np.sin(3 * times_s + 0.1))
    sensor = sensor_of(
        endless=np.array([True, False]),
        factor=np.array([-180 / np.pi, 1.0]),
        offset=np.array([0.2, 0.0]),
    )
    recorded = sensor.to_recorded(turned)
    recorded[:, 0] %= 360
    recorded[60:63, 0] = np.nan
    dataset = recorded_at_50_hz(tmp_path, recorded, 20)
    seen = ObservationModel.of_reality((sensor,), films=())
    read = RecordedReal(dataset, seen).collect()[0].readings["encoders"]
    at_s = np.arange(len(read)) / 20
    straight = np.stack([np.interp(at_s, times_s, column) for column in turned.T], 1)
    (jumps,) = np.nonzero(np.diff(turned[:, 1]))
    calm = np.abs(50 * at_s[:, None] - jumps - 0.5).min(1) > 4  # rows
    np.testing.assert_allclose(read[calm, 1], straight[calm, 1], atol=1e-9)
    assert np.flatnonzero(np.isnan(read[:, 0])).tolist() == [24, 25]
    off = read[:, 0] - (0.3 + 12 * at_s + 0.5 * np.sin(2 * at_s))
    np.testing.assert_allclose(np.delete(off, [24, 25]), off[0], atol=1e-6)
    assert abs(off[0] / (2 * np.pi) - round(off[0] / (2 * np.pi))) < 1e-6
    without = read_episode(dataset, 0, seen, pictures=False)
    np.testing.assert_array_equal(without.readings["encoders"], read)


def test_a_fast_swing_within_a_turn_stays_so_at_a_slower_rate(tmp_path):
    """It turns by more than half a turn in a step, but not from one row to the next."""
    swing = 2.5 * np.sin(2.4 * 2 * np.pi * np.arange(201) / 50)
    dataset = recorded_at_50_hz(tmp_path, np.stack([swing, swing], 1), 5)
    seen = ObservationModel.of_reality((sensor_of(endless=np.array([True, True])),), films=())
    read = RecordedReal(dataset, seen).collect()[0].readings["encoders"]
    assert np.abs(np.diff(read[:, 0])).max() > np.pi
    np.testing.assert_allclose(read[:, 0], swing[::10], atol=1e-9)


def test_only_hinges_without_limits_are_endless(tmp_path):
    toml = write_arm(tmp_path)
    assert load_task(str(toml)).sensors[0].endless is None
    model = toml.parent / "arm.xml"
    model.write_text(model.read_text().replace('range="-2 2" limited="true" ', "", 1))
    assert load_task(str(toml)).sensors[0].endless.tolist() == [True, False]


def test_hinges_and_slides_need_sensors_of_their_own_with_a_gain_too(tmp_path):
    toml = write_arm(tmp_path)
    model = toml.parent / "arm.xml"
    model.write_text(
        model.read_text().replace('name="elbow" axis', 'name="elbow" type="slide" axis', 1)
    )
    toml.write_text(toml.read_text().replace("noise = 0.002", "gain = 0.01"))
    with pytest.raises(InputError, match="give hinges and slides sensors of their own"):
        load_task(str(toml))
