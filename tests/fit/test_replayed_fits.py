"""How joint readings are fitted: derivatives of many unknowns at once, and horizons that grow."""

import json
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from servo_arm import write_arm

from simtune.budget import Budget
from simtune.config import TuneConfig
from simtune.experiment.experiment import build_experiment
from simtune.fit import Guess, OutputErrorMethod, Readings, ReplayStage
from simtune.fit.lateness import late_unit, steps_late
from simtune.fit.readings.differences import DifferencePoint, differentiate, refresh
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.segments import Segments
from simtune.fit.readings.slopes import Groups
from simtune.observation import JointSensor, ObservationModel, finds_offset
from simtune.simulation import Simulator
from simtune.tasks import load_task
from simtune.tuning.readings.agreement import agree, best_of, two_agree
from simtune.tuning.readings.descents import ReadingsDescents
from simtune.tuning.readings.horizons import Horizon, Horizons, Latency
from simtune.tuning.readings.whole import WholeFits

TRUTH = {"shoulder_kp": 60.0, "shoulder_kv": 4.0, "elbow_kp": 14.0, "elbow_friction": 0.3}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """An arm with servos of known numbers, and its readings."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "truth.json").write_text(json.dumps(TRUTH))
    config = TuneConfig(
        task=str(write_arm(folder)),
        out=folder / "run",
        real_parameters=folder / "truth.json",
        real_episodes=2,
    )
    experiment = build_experiment(config)
    context, space = experiment.context, experiment.space
    assert isinstance(context.simulator, Simulator)
    loop = set_up_loop(context.simulator, context.observation, context.start)
    readings = Readings.of(experiment.recordings, loop.sensors)
    start, truth = space.to_unit(context.start), space.to_unit(space.from_dict(TRUTH))
    fit = OutputErrorMethod(loop, finds_offset(loop.sensors), start)
    return SimpleNamespace(
        loop=loop, readings=readings, fit=fit, start=start, truth=truth, step_s=0.05
    )


def test_derivatives_of_many_unknowns_at_once_are_those_one_by_one(arm: SimpleNamespace):
    noise = np.full(2, 0.002)
    stretches = arm.loop.cut(arm.readings, arm.truth, segments=Segments.evenly(arm.readings, 20, 4))
    there = DifferencePoint(
        stretches, stretches.states, arm.truth, arm.loop.measured.start_std(noise, stretches)
    )
    near = there._replace(unit=arm.truth - 0.02)
    of_all = differentiate(arm.loop, there)

    begun = differentiate(arm.loop, near, one_sided=True)
    groups = Groups.of(begun, noise)
    few = refresh(arm.loop, there, begun, groups)

    assert len(groups.owner) < len(groups.number)
    size = np.abs(of_all.by_parameter).max()
    assert np.abs(few.by_parameter - of_all.by_parameter).max() < 0.05 * size
    before = np.abs(begun.by_parameter - of_all.by_parameter).max()
    assert np.abs(few.by_parameter - of_all.by_parameter).max() < before


def test_readings_that_no_unknown_explains_end_a_fit_without_an_error(arm: SimpleNamespace):
    """Such as degrees taken for radians: no derivative is worth an update."""
    in_degrees = Readings(arm.readings.actions, 57.3 * arm.readings.values)
    stage, guess = ReplayStage(3), Guess(arm.start, np.zeros(2))
    ended = arm.fit.descend(in_degrees, guess, stage, Budget())
    at = ended.objective.difference_point(ended.point)
    begun = differentiate(arm.loop, at)
    groups = Groups.of(begun, np.full(2, np.inf))
    assert (groups.number == -1).all()
    kept = refresh(arm.loop, at, begun, groups)
    np.testing.assert_array_equal(kept.by_parameter, begun.by_parameter)
    np.testing.assert_array_equal(kept.by_start, begun.by_start)
    np.testing.assert_array_equal(kept.predicted, begun.predicted)


def begun_anywhere(arm: SimpleNamespace, values: np.ndarray) -> tuple:
    """What `OpenLoopReplay.play` takes: three worlds of each whole episode, with initial states."""
    readings, rng = Readings(arm.readings.actions, values), np.random.default_rng(0)
    stretches = arm.loop.cut(readings, arm.start, segments=Segments.evenly(readings, 60, 9))
    units = np.append(arm.truth, 0.6) + rng.uniform(-0.02, 0.02, (3, 5))
    moved = rng.normal(size=(3, 2, arm.loop.physics.space.num_tangent))
    states = np.repeat(stretches.states[None], 3, 0)
    return stretches, arm.loop.physics.space.move(states, 0.05 * moved), units


@pytest.fixture
def sizes(arm: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Worlds and steps that are played at once."""
    played, play = [], arm.loop.physics.simulator.play

    def note(parameters: np.ndarray, act: Any, num_steps: int, *args: Any, **options: Any):
        played.append((len(parameters), num_steps))
        return play(parameters, act, num_steps, *args, **options)

    monkeypatch.setattr(arm.loop.physics.simulator, "play", note)
    return played


def test_worlds_that_memory_does_not_hold_at_once_are_played_in_turn(arm, sizes, monkeypatch):
    late = arm.loop.with_lateness()
    begun = begun_anywhere(arm, arm.readings.values)
    whole = late.play(*begun)
    assert sizes == [(6, 60)]
    num_bytes = 61 * begun[0].actuator_states.shape[1] * 8
    monkeypatch.setattr("simtune.fit.readings.parts._MOST_BYTES", 2 * num_bytes + 1)
    for found, expected in zip(late.play(*begun), whole, strict=True):
        np.testing.assert_array_equal(found, expected)
    assert sizes[1:] == 3 * [(2, 60)]


def test_what_a_short_episode_is_padded_with_is_neither_played_nor_counted(arm, sizes):
    late, values = arm.loop.with_lateness(), arm.readings.values.copy()
    whole, _ = late.play(*begun_anywhere(arm, values))
    values[1, 15:] = np.nan  # of the second episode a quarter
    found, _ = late.play(*begun_anywhere(arm, values))
    assert sizes == [(6, 60), (3, 60), (3, 15)]
    np.testing.assert_array_equal(found[:, 0], whole[:, 0])
    np.testing.assert_array_equal(found[:, 1, :15], whole[:, 1, :15])
    np.testing.assert_array_equal(found[:, 1, 16:], found[:, 1, 15:-1])
    noise, measured = np.full(2, 0.002), arm.loop.measured
    second = arm.loop.cut(replace(arm.readings, values=values), arm.truth).of([1])
    padded, short = (measured.start_std(noise, second.first(steps)) for steps in (60, 14))
    np.testing.assert_allclose(padded, short, rtol=1e-12)


def test_growing_horizons_end_at_the_truth(arm: SimpleNamespace):
    horizons = Horizons(growing=(Horizon(0.4, 3, 24), Horizon(1.0, 2, 12)))
    ends = (np.zeros(4), np.ones(4))
    fits = ReadingsDescents(arm.fit, arm.readings, arm.step_s, ends, horizons, 0)
    ended = fits.grow(fits.begin(arm.start), Budget())
    # Readings have a noise of .002 rad
    assert ended[0].log_rms < np.log(0.0026)
    assert np.abs(ended[0].unit - arm.truth).max() < 0.03


HORIZONTAL = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep=".01" integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" range="-2 2" armature=".01"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="40" kv="12" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
SERVO = """
model = "arm.xml"
control_timestep_s = 0.05
episode_steps = 60
[[sensors]]
name = "encoders"
joints = ["shoulder"]
noise = 0.001
[[parameters]]
name = "kp"
kind = "gain"
objects = "shoulder"
[[parameters]]
name = "kv"
kind = "gain_damping"
objects = "shoulder"
"""


def test_an_unknown_offset_makes_a_servo_that_sags_uncertain(tmp_path):
    """An encoder's offset looks like sag, the load over kp, if the arm hardly moves."""
    (tmp_path / "arm.xml").write_text(HORIZONTAL)
    (tmp_path / "tune.toml").write_text(SERVO)
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=32), ObservationModel.of_simulator(task.sensors)
    truth = task.parameters.from_dict({"kp": 48.0, "kv": 14.4})
    rng = np.random.default_rng(0)
    commands = np.repeat(rng.uniform(-0.08, 0.08, (4, 10, 1)), 6, 1)
    worlds = np.repeat(truth[None], 4, 0)
    played = simulator.roll_out(worlds, commands, rng, seen.observe_beside())
    readings = Readings(commands, seen.readings(played.observed, rng)["encoders"] + 0.03)
    loop = set_up_loop(simulator, seen, task.parameters.nominal)
    fit = OutputErrorMethod(
        loop, np.array([True]), task.parameters.to_unit(task.parameters.nominal)
    )
    horizons = Horizons(growing=(Horizon(0.25, 1, 48), Horizon(1.0, 1, 24)))
    fits = ReadingsDescents(fit, readings, 0.05, (np.zeros(2), np.ones(2)), horizons, 0)
    (ended,) = fits.grow(fits.begin(fit.prior), Budget())
    ended = fit.descend(readings, ended.guess, ReplayStage(15), Budget())
    found = fit.judge(ended, Budget())
    error, std = found.unit - task.parameters.to_unit(truth), np.sqrt(np.diag(found.covariance))
    assert (np.abs(error) < 3 * std).all()
    assert (std > 0.03).all()  # 0.002 if the offset were known
    assert found.offsets[0] == pytest.approx(0.03, abs=0.02)


def test_horizons_of_equal_steps_may_differ_in_stretches(arm: SimpleNamespace):
    """At ten readings a second, a quarter and half of a second are both the fewest steps."""
    horizons = Horizons(growing=(Horizon(0.25, 2, 5), Horizon(0.5, 1, 3)), iterations=2)
    ends = (np.zeros(4), np.ones(4))
    fits = ReadingsDescents(arm.fit, arm.readings, 0.1, ends, horizons, 0)
    ended = fits.grow(fits.begin(arm.start), Budget())
    assert np.isfinite(ended[0].log_rms)


@dataclass(frozen=True)
class Delayed(Readings):
    """That tell by how many steps."""

    late: int = 0

    def delayed(self, steps: int) -> "Delayed":
        return replace(self, late=steps)


class OneStepLate:
    """Fits that find a delay of a step, but for what a lateness cannot reach."""

    sensors, has_lateness = (), True

    def __init__(self):
        self.begun: list[tuple[int, float]] = []  # steps of actions, lateness in steps

    def descend(self, readings, begin, stage, budget, near=None) -> Any:
        self.begun.append((readings.late, float(steps_late(begin.unit[-1]))))
        late = np.clip(1.0 - readings.late, -0.75, 0.75)
        unit = np.append(begin.unit[:-1], late_unit(late))
        # What is left of the delay hardly counts: the servos' damping takes its place.
        log_rms = 0.04 * abs(1.0 - readings.late - late)
        ended = {"guess": Guess(unit, begin.offsets), "is_cut_off": budget.is_over}
        return SimpleNamespace(unit=unit, log_rms=log_rms, **ended)


def test_a_delay_of_a_step_is_not_left_to_a_lateness_that_ends_before():
    fit = OneStepLate()
    readings = Delayed(np.zeros((1, 39, 1)), np.zeros((1, 40, 1)))
    ends = (np.zeros(2), np.array([1.0, 0.0]))
    horizons = Horizons(growing=(Horizon(0.4, 1, 24),))
    fits = ReadingsDescents(fit, readings, 0.05, ends, horizons, 0)  # type: ignore[arg-type]
    first = Guess(np.array([0.5, late_unit(0.0)]), np.zeros(1))
    guess, latency = fits.find_latency(first, Budget())
    assert latency == (1, True)
    assert steps_late(guess.unit[-1]) == pytest.approx(-0.25)
    # Each number of steps begins with the whole delay as it was
    (late, lateness), *_ = (begun for begun in fit.begun if begun[0] == 1)
    assert late + lateness == pytest.approx(0.75)


class Hurry(Budget):
    """Of which each descent of `Slow` takes three seconds."""

    left_s = 10.0

    @property
    def seconds_left(self) -> float:
        return max(0.0, self.left_s)

    def part(self, seconds, span=(0.0, 1.0), prefix="") -> Budget:
        return self


class Slow(OneStepLate):
    def descend(self, readings, begin, stage, budget, near=None) -> Any:
        budget.left_s -= 3
        return super().descend(readings, begin, stage, budget, near)


def test_a_search_for_a_delay_that_time_cut_off_does_not_know_it():
    readings = Delayed(np.zeros((1, 39, 1)), np.zeros((1, 40, 1)))
    ends, horizons = (np.zeros(2), np.array([1.0, 0.0])), Horizons(growing=(Horizon(0.4, 1, 24),))
    fits = ReadingsDescents(Slow(), readings, 0.05, ends, horizons, 0)  # type: ignore[arg-type]
    first = Guess(np.array([0.5, late_unit(0.0)]), np.zeros(1))
    assert fits.find_latency(first, Hurry(10.0))[1] == (1, False)


def sensor(noise: float | None = None) -> JointSensor:
    return JointSensor(
        name="encoder",
        columns=("a",),
        joints=("a",),
        places=np.zeros(1, int),
        factor=np.ones(1),
        shift=np.zeros(1),
        noise=noise,
    )


def whole_fits(method: Any, readings: Any, num: int = 3) -> WholeFits:
    return WholeFits(method, readings, np.ones(num, bool), Horizons(), 10, 0)


class Rough:
    """Descents of which no two to whole episodes end alike, but those to stretches do."""

    has_lateness = False

    def __init__(self, agreeing_steps: int | None, sensor: JointSensor):
        self.sensors, self.rng, self._steps = (sensor,), np.random.default_rng(0), agreeing_steps
        self.stages: list[int | None] = []  # steps of each; None: of whole episodes

    def follow(self, readings: Readings, guess: Guess) -> Segments:
        return Segments.evenly(readings)

    followed = follow

    def descend(self, readings, begin, stage, budget, near=None) -> Any:
        self.stages.append(None if stage.goes_on else stage.segments.steps[0])
        is_alike = self.stages[-1] == self._steps
        log_rms = 0.0 if is_alike else float(self.rng.uniform(1, 9))
        noise = np.full(1, 0.001)
        its = {"unit": begin.unit, "begun": begin.unit, "guess": begin}
        return SimpleNamespace(**its, log_rms=log_rms, noise=noise, is_cut_off=False)


@pytest.mark.parametrize(
    ("agreeing_steps", "declared", "is_whole", "is_sure"),
    [(40, 0.001, False, True), (None, 0.001, True, True), (40, None, True, False)],
)
def test_what_only_stretches_tell_twice_is_theirs_where_they_leave_but_noise(
    agreeing_steps: int | None, declared: float | None, is_whole: bool, is_sure: bool
):
    fit, readings = (
        Rough(agreeing_steps, sensor(declared)),
        Readings(np.zeros((1, 99, 1)), np.zeros((1, 100, 1))),
    )
    ends = (np.zeros(3), np.ones(3))
    fits = ReadingsDescents(fit, readings, 0.05, ends, Horizons(), 0)  # type: ignore[arg-type]
    ended = fits.grow(fits.begin(np.full(3, 0.5)), Budget())
    found, _ = whole_fits(fit, readings).fit_until_two_agree(ended, Latency(), Budget())
    assert found.is_whole == is_whole
    assert found.is_sure == is_sure
    assert not found.lacked_time  # where no two agree, all fits were made
    assert fit.stages[:3] == [8, 8, 8]  # a quarter of a second is no less than eight steps
    assert fit.stages.count(None) == (4 if not is_whole else 2 if is_sure else Horizons().most_fits)


@pytest.mark.parametrize(("followed", "steps"), [(0, {8}), (12, {8, 10}), (99, {8, 10, 20, 40})])
def test_stretches_are_no_longer_than_replays_can_be_followed(followed: int, steps: set[int]):
    class Falling(Rough):
        def followed(self, readings: Readings, guess: Guess) -> Segments:
            return Segments(np.zeros(3, int), np.arange(3), np.full(3, followed))

    readings, ends = (
        Readings(np.zeros((1, 99, 1)), np.zeros((1, 100, 1))),
        (np.zeros(3), np.ones(3)),
    )
    fit = Falling(None, sensor())
    fits = ReadingsDescents(fit, readings, 0.05, ends, Horizons(), 0)  # type: ignore[arg-type]
    fits.grow(fits.begin(np.full(3, 0.5)), Budget())
    assert set(fit.stages) == steps


class Swinging(Rough):
    """What a fit finds is followed by other segments than what it began with: by two in turn."""

    def follow(self, readings: Readings, guess: Guess) -> Segments:
        whole = Segments.evenly(readings)
        return whole._replace(steps=whole.steps - len(self.stages) % 2)


def test_of_segments_that_lead_to_each_other_the_first_are_kept():
    fit = Swinging(None, None)  # type: ignore[arg-type]
    readings = Readings(np.zeros((1, 99, 1)), np.zeros((1, 100, 1)))
    guess = Guess(np.full(3, 0.5), np.zeros(1))
    _, segments, _ = whole_fits(fit, readings)._first_whole(readings, guess, Budget())
    assert len(fit.stages) == 2
    assert segments.steps.tolist() == [99]


class Late(Rough):
    """What readings by `late` steps leave after actions; a lateness makes up for .75 steps."""

    has_lateness, late = True, 2.2

    def descend(self, readings, begin, stage, budget, near=None) -> Any:
        steps = 10 - np.flatnonzero(readings.values[0, :, 0] == 1)[0]
        lateness = np.clip(self.late - steps, -0.75, 0.75)
        unit = np.append(begin.unit[:-1], late_unit(lateness))
        left, guess = abs(self.late - steps - lateness), begin._replace(unit=unit)
        its = {"unit": unit, "begun": begin.unit, "guess": guess, "noise": np.ones(1)}
        return SimpleNamespace(**its, log_rms=left, is_cut_off=False)


@pytest.mark.parametrize(
    ("late", "steps", "found"), [(2.2, 1, 2), (1.1, 2, 1), (1.5, 1, 1), (9.0, 1, 9), (0.2, 0, 0)]
)
def test_a_lateness_of_over_half_a_step_goes_on_to_the_next_ones(late, steps, found):
    """1 + .75 hides .45 of 2.2 steps, which other parameters would explain; 9 are seven further."""
    fit = Late(None, sensor())
    fit.late, values = late, np.zeros((1, 100, 1))
    values[0, 10] = 1
    fits = whole_fits(fit, Readings(np.zeros((1, 99, 1)), values))
    begin: Any = SimpleNamespace(guess=Guess(np.full(3, 0.5), np.zeros(1)))
    begin.log_rms, begin.noise = 9.0, np.ones(1)
    best, latency = fits.fit_until_two_agree([begin], Latency(steps), Budget())
    assert latency == (found, True)
    assert best.best.log_rms == pytest.approx(max(0, late - found - 0.75))


def test_another_start_is_elsewhere_also_where_the_best_is_at_a_bound():
    fits, rng = whole_fits(None, None, 1), np.random.default_rng(0)
    for unit in (0.0, 0.5, 1.0):
        best: Any = SimpleNamespace(unit=np.array([unit]), guess=SimpleNamespace(offsets=0.0))
        for together in 20 * [True, False]:
            start = fits._start_near(best, rng, together).unit
            assert 0 <= start <= 1
            assert abs(start - unit) > 0.0299


def test_twice_means_nearly_the_same_residuals():
    def leaving(*log_rms: float) -> list[Any]:
        return [SimpleNamespace(log_rms=each) for each in log_rms]

    assert two_agree(leaving(-5.0, -2.0, -4.99))
    assert not two_agree(leaving(-5.0, -4.9))
    assert not two_agree(leaving(-5.0))


def test_fits_agree_that_end_at_one_answer_whatever_they_leave():
    def ending(*ends: tuple[float, float], begun: float = 0.4) -> list[Any]:
        starts = {"begun": np.array([begun, 0.0]), "is_cut_off": False}
        return [SimpleNamespace(**starts, log_rms=r, unit=np.array([x, 0.0])) for r, x in ends]

    moving = np.array([True, False])
    assert agree(ending((-5.0, 0.500), (-4.0, 0.507)), moving)
    assert not agree(ending((-5.0, 0.500), (-4.0, 0.530)), moving)
    # One that began there and did not move confirms nothing
    assert not agree(ending((-5.0, 0.500), (-4.0, 0.507), begun=0.507), moving)
    found = best_of(ending((-5.0, 0.500), (-4.0, 0.530), (-4.5, 0.492)), moving, True)
    assert found.is_sure
    np.testing.assert_allclose(found.apart, [-0.004])
    unsure = best_of(ending((-5.0, 0.500), (-4.0, 0.600), (-4.5, 0.530)), moving, True)
    assert not unsure.is_sure
    np.testing.assert_allclose(unsure.apart, [0.015])  # from the next best
    fits = ending((-5.0, 0.500), (-4.0, 0.600), (-4.5, 0.530))
    fits[2].is_cut_off = True
    np.testing.assert_allclose(best_of(fits, moving, True).apart, [0.05])
    assert best_of(ending((-5.0, 0.5)), moving, True).apart.tolist() == [0.0]
