"""Slopes across what is rough, and what a fit claims of where its two sides end: by hand."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from simtune.budget import NO_LIMIT, Budget, OutOfTime
from simtune.fit import Observed, Physics, PointEstimate
from simtune.fit.motion.linearization import LinearizationPoint, WindowPlayer
from simtune.fit.motion.shooting import ShootingFit
from simtune.fit.motion.shooting_config import Spans
from simtune.fit.motion.two_sides import fit_from_two_sides
from simtune.fit.motion.windows import Windows
from simtune.fit.physics import _DIVERGED_READING, is_lost
from simtune.observation import AllEvidence
from simtune.parameters import Parameter, ParameterSpace
from simtune.simulation import PictureSettings, Scene, Simulator
from simtune.tasks import load_task

SPACE = load_task("cartpole").parameters
MOVING = np.flatnonzero(~SPACE.is_appearance)
ROUGHNESS, SLOPE = 1e-3, 2.0


class RoughPhysics:
    """Predicts SLOPE times the parameter, and the state's first number; both are rough."""

    space = SimpleNamespace(num_tangent=2, move=lambda states, tangents: states + tangents)

    def play(self, states, units, actions, actuator_states, predictions_per_step):
        rough = ROUGHNESS * np.sin(7e4 * (units[:, 0] + states[:, 0]))
        predicted = SLOPE * units[:, 0] + states[:, 0] + rough
        return np.zeros((len(states), 2, 1)), np.tile(predicted[:, None, None], (1, 2, 1))


class DivergingPhysics(RoughPhysics):
    """The second of three windows diverges in every world of a larger parameter."""

    def play(self, states, units, actions, actuator_states, predictions_per_step):
        full_states, predicted = super().play(states, units, actions, actuator_states, 1)
        diverged = (np.arange(len(states)) % 3 == 1) & (units[:, 0] > 0.5)
        return full_states, np.where(diverged[:, None, None], _DIVERGED_READING, predicted)


def slopes_at(unit: float, physics: type = RoughPhysics):
    states = np.array([[0.1, 0.0], [0.2, 0.0], [0.31, 0.0]])
    none = np.zeros((3, 1))
    windows = Windows(AllEvidence(()), none[:, None], states, none, np.zeros(3), np.zeros(3))
    player = WindowPlayer(physics(), np.full(2, 1.0), np.array([0]), Spans())  # pyright: ignore
    point = LinearizationPoint(states, np.array([unit]), np.zeros(3), 0.02**2)
    return player.differentiate(windows, point)


@pytest.mark.parametrize("unit", [0.0, 0.003, 0.5, 1.0])
def test_slopes_are_no_steeper_than_what_they_cross_in_between_and_at_bounds(unit):
    """A thousandth beside the point they would be off by up to 2 of 2."""
    slopes = slopes_at(unit)
    # The roughness at both ends, over the distance of .01 to .02 between them
    np.testing.assert_allclose(slopes.by_parameter, SLOPE, atol=2 * ROUGHNESS / 0.01)
    np.testing.assert_allclose(slopes.by_state[:, 0], 1.0, atol=2 * ROUGHNESS / 0.03)
    np.testing.assert_array_equal(slopes.by_state[:, 1], 0.0)


def test_of_a_window_that_diverges_on_one_side_the_other_side_tells():
    slopes = slopes_at(0.5, DivergingPhysics).by_parameter[:, 0, :, 0]
    np.testing.assert_allclose(slopes, SLOPE, atol=2 * ROUGHNESS / 0.01)


@pytest.mark.parametrize("unit", [0.6, 1.0])
def test_a_window_that_diverges_at_the_point_says_nothing(unit):
    slopes = slopes_at(unit, DivergingPhysics)
    assert not slopes.by_parameter[1].any()
    assert not slopes.by_state[1].any()
    np.testing.assert_allclose(slopes.by_parameter[[0, 2]], SLOPE, atol=2 * ROUGHNESS / 0.01)
    np.testing.assert_allclose(slopes.by_state[[0, 2], 0], 1.0, atol=2 * ROUGHNESS / 0.03)


STIFF = """
<mujoco><option timestep=".005" integrator="Euler"/>
  <worldbody><body name="arm"><joint name="turn" axis="0 1 0" damping=".05"/>
    <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass=".1"/></body></worldbody>
  <actuator><position name="servo" joint="turn" kp="1000"/></actuator></mujoco>"""


@pytest.mark.parametrize("per_step", [1, 2])
def test_a_world_is_lost_where_its_physics_stopped_at_huge_numbers(per_step):
    gain = Parameter(
        name="gain", field="actuator_gainprm", component=0, objects=("servo",), nominal=100.0,
        low=10.0, high=1e6, unit="Nm/rad",
    )  # fmt: skip
    space, model = ParameterSpace([gain]), mujoco.MjModel.from_xml_string(STIFF)
    scene = Scene(model=model, space=space, step_s=0.05, initialize=lambda batch, rng: None)
    simulator = Simulator(scene, PictureSettings(image_size=1))
    begun = simulator.begin(np.array([[100.0]]), np.random.default_rng(0)).states[0, 0]
    physics = Physics(simulator, lambda batch: batch.qpos.copy(), begun)
    units = space.to_unit(np.array([[100.0], [600.0], [1e5]]))
    states, actions = np.tile([[0.05, 0.0]], (3, 1)), np.full((3, 12, 1), 0.01)
    full_states, predicted = physics.play(states, units, actions, None, per_step)
    assert np.isfinite(full_states).all()
    assert is_lost(predicted).tolist() == [False, True, True]
    starts = physics.full_states(states)
    rng, gains = np.random.default_rng(0), space.from_unit(units)
    played = simulator.play(gains, lambda t, _: actions[:, t], 12, rng, starts=starts)
    assert 0 < played.lengths[1] < 12
    lost = np.isclose(predicted[..., 0], _DIVERGED_READING).sum(1)
    np.testing.assert_array_equal(lost, (12 - played.lengths) * per_step)


class Contraction:
    """Fits that go `1 - left` of the way to the truth; a longer horizon moves by `moved`."""

    fitted = MOVING

    def __init__(self, truth: np.ndarray, left: float, moved: float | None):
        self.truth, self.left, self.moved = truth, left, moved

    def fit(self, observed, states, parameters) -> ShootingFit:
        begun = SPACE.to_unit(parameters)[MOVING]
        return self._at(self.truth + self.left * (begun - self.truth))

    def extend_horizon(self, observed, states, parameters, fit: ShootingFit, _) -> ShootingFit:
        return self._at(fit.unit + self.moved)

    def _at(self, unit: np.ndarray) -> ShootingFit:
        none = np.zeros(1)
        return ShootingFit(unit, np.zeros((2, 2)), none, none, none, none, (0.0,), none)


def fit_motion(truth: np.ndarray, std: float, left: float, moved: float | None = None):
    start = PointEstimate(SPACE.nominal, np.full(len(SPACE), std))
    shooting = Contraction(truth, left, moved)
    nothing = Observed(AllEvidence(()), np.zeros((1, 4, 1)))
    states, longer_within = np.zeros((1, 5, 4)), None if moved is None else NO_LIMIT
    return fit_from_two_sides(shooting, SPACE, nothing, states, start, longer_within)[:2]  # pyright: ignore


def test_what_a_fit_claims_grows_with_how_far_it_had_to_go_and_outlives_a_longer_horizon():
    unit = SPACE.to_unit(SPACE.nominal)[MOVING]
    near, far = unit + 0.01, unit + 0.1
    # A tenth of the way is left: of ±.02 each side ends .002 off the middle, which is .001 off.
    fit, off = fit_motion(near, 0.02, 0.1)
    np.testing.assert_allclose(fit.unit, near - 0.001, atol=1e-9)
    np.testing.assert_allclose(np.abs(off), 0.002, atol=1e-9)
    # From .033 away the middle went .03, half as far again as the sides began: it is .0033 off.
    fit, off = fit_motion(unit + 0.1 / 3, 0.02, 0.1)
    np.testing.assert_allclose(fit.unit, unit + 0.03, atol=1e-9)
    np.testing.assert_allclose(np.abs(off), 1.5 * 0.002, atol=1e-9)
    _, off = fit_motion(far, 0.02, 0.1)  # 4.5 times as far, of which 2 count
    np.testing.assert_allclose(np.abs(off), 2 * 0.002, atol=1e-9)
    # A longer horizon that hardly moves is no proof; one that does tells what misled.
    _, off = fit_motion(far, 0.02, 0.1, moved=0.0004)
    np.testing.assert_allclose(np.abs(off), 2 * 0.002, atol=1e-9)
    fit, off = fit_motion(far, 0.02, 0.1, moved=0.03)
    np.testing.assert_allclose(fit.unit, far + 0.02, atol=1e-9)
    np.testing.assert_allclose(np.abs(off), 0.015, atol=1e-9)


def test_physics_within_a_budget_plays_nothing_once_it_is_over():
    simulator = load_task("cartpole").simulator(image_size=48)
    rollouts = simulator.roll_out(
        SPACE.nominal[None], np.zeros((1, 1, 1)), np.random.default_rng(0)
    )
    physics = Physics(simulator, lambda batch: batch.qpos.copy(), rollouts.states[0, 0])
    states, units = physics.some_state[None], SPACE.to_unit(SPACE.nominal)[None]
    with pytest.raises(OutOfTime):
        physics.within(Budget(0.0)).play(states, units, np.zeros((1, 3, 1)))
    played, _ = physics.within(Budget(60.0)).play(states, units, np.zeros((1, 3, 1)))
    np.testing.assert_array_equal(played, physics.play(states, units, np.zeros((1, 3, 1)))[0])
