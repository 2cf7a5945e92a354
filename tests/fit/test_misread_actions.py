"""Reversed and exchanged actions are told by a motion that only they explain."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from keypoint_evidence import observed_keypoints

from simtune.budget import OutOfTime
from simtune.fit import FitConfig, Observed, Physics
from simtune.fit.fit_setup import FitSetup
from simtune.fit.misread_actions import misread_actions
from simtune.randomization import Distribution
from simtune.simulation import Simulator, random_actions
from simtune.tasks import Task, load_task
from simtune.vision.keypoints import Keypoints, find_keypoints

NOISE_PX, STEPS = 0.2, 40


class RoughGuess:
    """First guesses at states: the true ones with errors."""

    def __init__(self, physics: Physics, states: np.ndarray):
        rng, space = np.random.default_rng(0), physics.space
        errors = rng.normal(size=(*states.shape[:2], space.num_tangent))
        self.prior_std = np.repeat([0.03, 0.3], space.nv)
        self._states = space.move(physics.states(states), errors * self.prior_std)

    def __call__(self, observed: Observed) -> np.ndarray:
        return self._states


def played(task: Task) -> tuple[Simulator, Keypoints, Any]:
    """Three episodes of another world than the nominal one, as keypoints show them."""
    simulator, rng = task.simulator(image_size=48), np.random.default_rng(0)
    space = simulator.space
    keypoints = find_keypoints(simulator, Distribution.first(space, space.nominal), 0)
    truth = space.clip(space.nominal * np.where(space.is_appearance, 1.0, 1.3))
    actions = random_actions(3, STEPS, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(np.tile(truth, (3, 1)), actions, rng, keypoints.observe)
    return simulator, keypoints, rollouts


def told(
    name: str, recorded: Any, latencies: tuple[int, ...] = (0,), model: Task | None = None
) -> list[str]:
    """`recorded`: makes the recorded actions of those carried out; `model`: if it is another."""
    simulator, keypoints, rollouts = played(load_task(name))
    simulator = model.simulator(image_size=48) if model else simulator
    rng = np.random.default_rng(1)
    points = rollouts.observed + NOISE_PX * rng.normal(size=rollouts.observed.shape)
    observed = observed_keypoints(points, recorded(rollouts.actions), NOISE_PX, 48)
    physics = Physics(simulator, keypoints.observe, rollouts.states[0, 0])
    guess = cast(Any, RoughGuess(physics, rollouts.states))
    setup = FitSetup(physics, guess, FitConfig())
    return misread_actions(setup, observed, simulator.space.nominal, latencies)


def late(actions: np.ndarray) -> np.ndarray:
    """Recorded two steps before they were carried out."""
    return np.concatenate([actions[:, 2:], actions[:, -2:]], 1)


def test_a_reversed_motor_is_told_however_late_it_is():
    said = "motion: slide seems to push the other way, or the film is mirrored. Then short parts"
    for recorded in (lambda actions: -actions, lambda actions: -late(actions)):
        (found,) = told("cartpole", recorded, (0, 2))
        assert said in found
    assert told("cartpole", lambda actions: actions) == []
    assert told("cartpole", late, (0, 2)) == []


def test_actions_are_not_blamed_for_a_pole_that_is_too_long():
    task = load_task("cartpole")
    spec = task.load_spec()
    for geom in spec.geoms:
        if geom.name == "pole_1":
            geom.fromto = [0, 0, 0, 0, 0, 1.5]
    assert told("cartpole", lambda actions: actions, model=replace(task, load_spec=spec.copy)) == []


def test_exchanged_motors_are_told():
    (found,) = told("finger", lambda actions: actions[..., ::-1])
    assert "motion: actions of proximal and distal seem to be exchanged. Then short parts" in found


def test_motors_that_are_all_reversed_are_told_at_once():
    (found,) = told("finger", lambda actions: -actions)
    said = "motion: proximal and distal seem to push the other way, or the film is mirrored. Then"
    assert said in found


def test_changes_are_found_one_after_the_other(monkeypatch):
    """Each action that is not as it was carried out adds as much to the misfit."""
    carried_out = np.array([1.0, 2.0, 3.0])

    def fit(_, observed: Observed, *rest: object) -> Any:
        misfit = 0.5 + 2 * np.count_nonzero(observed.actions[0, 0] != carried_out)
        return SimpleNamespace(misfit=np.full(10, misfit), distances=(misfit, np.nan))

    names = ("hip", "knee", "foot")
    monkeypatch.setattr("simtune.fit.misread_actions._fit", fit)
    monkeypatch.setattr("simtune.simulation.other_actions._of_motors", lambda _: [0, 1, 2])
    mapping = SimpleNamespace(names=names, range=np.tile([-9.0, 9.0], (3, 1)))
    simulator = SimpleNamespace(action_mapping=mapping, num_actions=3)
    physics = cast(Any, SimpleNamespace(simulator=simulator, within=lambda _: physics))
    setup = FitSetup(physics, cast(Any, None), FitConfig())
    reversed_, exchanged = carried_out * [-1, 1, -1], carried_out[[0, 2, 1]]
    for recorded, ratio, says in (
        (carried_out, 1, None),
        (
            reversed_,
            9,
            "hip seems to push the other way, and foot seems to push the other way. Then",
        ),
        (exchanged, 9, "motion: actions of knee and foot seem to be exchanged. Then"),
        (
            -carried_out,
            13,
            "motion: hip and knee and foot seem to push the other way, or the film is",
        ),
    ):
        observed = observed_keypoints(np.zeros((1, 2, 2)), recorded[None, None], NOISE_PX)
        said = misread_actions(setup, observed, np.zeros(1), [0])
        assert bool(said) == bool(says)
        assert not says or says in said[0]
        assert not says or f"short parts of it end {ratio:.1f} times as near" in said[0]


def test_what_was_found_when_the_time_is_over_counts(monkeypatch):
    """The first change explains it; the second one's fit does not end."""
    carried_out, ends = np.array([1.0, 2.0]), 0  # so many fits end in time

    def fit(_, observed: Observed, *rest: object) -> Any:
        nonlocal ends
        ends -= 1
        if ends < 0:
            raise OutOfTime
        misfit = 0.5 + 2 * np.count_nonzero(observed.actions[0, 0] != carried_out)
        return SimpleNamespace(misfit=np.full(10, misfit), distances=(misfit, np.nan))

    monkeypatch.setattr("simtune.fit.misread_actions._fit", fit)
    monkeypatch.setattr("simtune.simulation.other_actions._of_motors", lambda _: [0, 1])
    mapping = SimpleNamespace(names=("hip", "knee"), range=np.tile([-9.0, 9.0], (2, 1)))
    simulator = SimpleNamespace(action_mapping=mapping, num_actions=2)
    budgets = []
    physics = cast(Any, SimpleNamespace(simulator=simulator))
    physics.within = lambda budget: budgets.append(budget) or physics
    setup = FitSetup(physics, cast(Any, None), FitConfig())
    observed = observed_keypoints(np.zeros((1, 2, 2)), (carried_out * [-1, 1])[None, None], 1.0)
    for num, is_found in ((0, False), (1, False), (2, True)):
        ends = num
        assert bool(misread_actions(setup, observed, np.zeros(1), [0])) == is_found
    assert all(budget.seconds == 12 for budget in budgets)
