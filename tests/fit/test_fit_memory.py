"""Actuators that remember: a fit's windows begin with what earlier actions left behind."""

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
from keypoint_evidence import observed_keypoints
from late_actuators import delay
from servo import cartpole_with_servo

from simtune.fit import Observed, Physics
from simtune.fit.motion.particles import Particles
from simtune.fit.motion.shooting import Shooting
from simtune.fit.motion.shooting_config import ShootingConfig
from simtune.parameters import Parameter, ParameterSpace
from simtune.randomization import Distribution
from simtune.simulation import JointActions, random_actions
from simtune.tasks import Task, load_task
from simtune.vision.keypoints import find_keypoints

CARTPOLE = load_task("cartpole")
SPREAD = np.array([0.05, 0.05, 0.2, 0.2])
STEPS = 96


@pytest.fixture(autouse=True)
def _nothing_is_drawn(monkeypatch):
    """Renderers take half a second to make."""
    monkeypatch.setattr("simtune.simulation.rendering.renderers.make_renderer", lambda *_: None)


def late_cartpole() -> Task:
    """A pole mass, a gain, and a delay of up to three steps of 0.08 s."""
    dynamics = [p for p in CARTPOLE.parameters if not p.is_appearance]
    return replace(
        CARTPOLE, parameters=ParameterSpace([*dynamics, delay("late", ("slide",), 0.24)])
    )


def slow_cartpole() -> Task:
    """Its motor follows within 0.1 s or so, by a filter."""

    def load_spec() -> mujoco.MjSpec:
        spec = CARTPOLE.load_spec()
        motor = spec.actuator("slide")
        motor.dyntype, motor.dynprm[0] = mujoco.mjtDyn.mjDYN_FILTER, 0.1
        return spec

    dynamics = [p for p in CARTPOLE.parameters if not p.is_appearance]
    return replace(CARTPOLE, load_spec=load_spec, parameters=ParameterSpace(dynamics))


def servo_cartpole(slow_s: float = 0.0) -> Task:
    """Its cart is displaced from where it is by a servo that follows late, or slowly."""

    load_spec = partial(cartpole_with_servo, kv=2, timeconst=slow_s or -1)
    dynamics = [p for p in CARTPOLE.parameters if not p.is_appearance]
    space = [*dynamics, *([] if slow_s else [delay("late", ("slide",), 0.24)])]
    actions = partial(JointActions, per_unit=0.3)
    return replace(
        CARTPOLE, load_spec=load_spec, parameters=ParameterSpace(space), map_actions=actions
    )


def played(task: Task, truth: np.ndarray):
    """Three episodes, and all that a fit needs to know of them."""
    simulator, rng = task.simulator(image_size=64), np.random.default_rng(0)
    first = Distribution.first(task.parameters, task.parameters.nominal)
    keypoints = find_keypoints(simulator, first, 0)
    actions = random_actions(3, STEPS, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(np.repeat(truth[None], 3, 0), actions, rng, keypoints.observe)
    physics = Physics(simulator, keypoints.observe, rollouts.states[0, 0])
    return physics, rollouts


def detected(rollouts) -> Observed:
    """Keypoints as a nearly perfect detector finds them."""
    return observed_keypoints(rollouts.observed, rollouts.actions, noise_px=0.2)


def lagging_cartpole() -> Task:
    """The time constant of such a filter is to be found as well."""
    dynamics = [p for p in CARTPOLE.parameters if not p.is_appearance]
    lag = Parameter(
        name="lag",
        field="actuator_dynprm",
        objects=("slide",),
        component=0,
        nominal=0.05,
        low=0.005,
        high=0.5,
        unit="s",
        kind="lag",
    )
    return replace(CARTPOLE, parameters=ParameterSpace([*dynamics, lag]))


CASES = {"delay": (late_cartpole, [0.08, 7.0, 0.19]), "filter": (slow_cartpole, [0.08, 7.0])}
CASES["lag"] = lagging_cartpole, [0.08, 7.0, 0.12]
SERVOS = {
    "late servo": (servo_cartpole, [0.08, 7.0, 0.19]),
    "slow servo": (partial(servo_cartpole, slow_s=0.15), [0.08, 7.0]),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", [*CASES, *SERVOS])
def test_window_with_replayed_actuators_moves_as_its_episode(name):
    make, truth = (CASES | SERVOS)[name]
    task = make()
    physics, rollouts = played(task, np.array(truth))
    at, length = 40, 12
    states, actions = physics.states(rollouts.states), rollouts.actions[:, at : at + length]
    unit = task.parameters.to_unit(np.array(truth))
    actuator_states = physics.replay_actuators(rollouts.actions, states, unit)[:, at]
    units = np.tile(unit, (3, 1))
    again, _ = physics.play(states[:, at], units, actions, actuator_states)
    np.testing.assert_allclose(physics.states(again), states[:, at : at + length + 1], atol=1e-6)
    forgetful, _ = physics.play(states[:, at], units, actions)
    assert np.abs(physics.states(forgetful) - states[:, at : at + length + 1]).max() > 0.01


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n != "lag")) for n in CASES]
)
def test_fit_recovers_delay_and_gain_from_windows_inside_episodes(name):
    make, truth = CASES[name]
    task, truth = make(), np.array(truth)
    physics, rollouts = played(task, truth)
    space, fitted, rng = task.parameters, np.arange(len(truth)), np.random.default_rng(1)
    config = ShootingConfig(longer=(), num_windows=30)
    states = physics.states(rollouts.states)
    rough = states + SPREAD * rng.normal(size=states.shape)
    start = space.from_unit(space.to_unit(truth) + 0.1)
    fit = Shooting(physics, SPREAD, fitted, config).fit(detected(rollouts), rough, start)
    found = space.from_unit(fit.unit)
    np.testing.assert_allclose(found, truth, rtol=0.03)

    particles = Particles(physics, SPREAD, fitted, 128)
    unit = space.to_unit(start)
    followed = particles.follow(detected(rollouts), rough, unit, np.full(len(unit), 0.1))
    error = np.abs(physics.space.difference(followed.states, states)).mean((0, 1))
    # Without any memory .2 to .5; steps begin as the first guess at a lag has filters follow.
    assert (error[:2] < SPREAD[:2] * (1.6 if name == "lag" else 1.1)).all()
