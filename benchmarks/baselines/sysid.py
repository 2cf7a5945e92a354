"""mujoco.sysid given the true states: least squares, as the bound that privileged data sets.

It sees no video, and so no colours. Episodes are cut into short pieces, each simulated from its
own true state: over whole episodes contacts make the residual rugged.
"""

import copy
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from baselines import Found, Problem
from simtune.parameters import ModelWriter, ParameterSpace
from simtune.simulation import Simulator, StateSpace

_PIECE_STEPS = 2  # policy steps
_MAX_ITERATIONS = 50
_DIFFERENCE = 0.01  # for derivatives: on smaller scales contacts make the residual rugged


def find(problem: Problem) -> Found:
    from mujoco import sysid

    assert problem.true_states is not None, "the only thing it looks at"
    whole, simulator = problem.first.space, problem.simulator
    space = ParameterSpace([p for p in whole if not p.is_visible], whole.where)
    start = space.from_dict({n: whole.to_dict(problem.first.mean)[n] for n in space.names})
    # In unit coordinates, in which a step means the same for every parameter.
    unknown = sysid.ParameterDict()
    for name, value in zip(space.names, space.to_unit(start), strict=True):
        unknown.add(sysid.Parameter(name, value, 0.0, 1.0))
    residual = sysid.build_residual_fn(
        models_sequences=[_pieces(problem, sysid)],
        build_model=_builder(simulator, space),
        modify_residual=_residual(simulator.num_substeps, problem.true_states, simulator.model),
        resample_true=False,
        n_threads=1,
    )
    steps_a_jacobian = sum(map(len, problem.real)) * (len(space) + 2)
    found, fit = sysid.optimize(
        initial_params=unknown.move_off_bounds(),
        residual_fn=residual,
        verbose=False,
        xtol=1e-5,
        eps=_DIFFERENCE,
        max_iters=int(np.clip(problem.budget_steps / steps_a_jacobian, 1, _MAX_ITERATIONS)),
    )
    x = found.as_vector()
    left, _, _ = residual(x, found)
    _, half = sysid.calculate_intervals([r.ravel() for r in left], fit.jac, alpha=0.1)
    ends = (space.from_unit(x - half), space.from_unit(x), space.from_unit(x + half))
    low, mean, high = (space.to_dict(values) for values in ends)
    return Found(mean, low, high)


def _pieces(problem: Problem, sysid: Any) -> Any:
    """The episodes as sysid's ModelSequences: each piece with the true state it starts from."""
    spec = mujoco.MjSpec()  # in name only: the builder writes into the compiled model
    sequences = sysid.ModelSequences("real", spec, [], [], [], [])
    for trajectory, states in zip(problem.real, problem.true_states, strict=True):
        for at in range(0, len(trajectory) - _PIECE_STEPS + 1, _PIECE_STEPS):
            piece = slice(at, at + _PIECE_STEPS)
            seen = states[at : at + _PIECE_STEPS + 1]
            sequences.measured_rollout.append(
                _piece(problem.simulator, trajectory.actions[piece].astype(float), seen, sysid)
            )
    return sequences


def _piece(simulator: Simulator, actions: np.ndarray, states: np.ndarray, sysid: Any) -> Any:
    """A piece of an episode: (T, A) actions, and the (T + 1, S) states between them."""
    model = simulator.model
    names = sysid.TimeSeries.compute_all_state_mappings(model)
    moving = simulator.state_space.positions_and_velocities(states)
    positions, velocities = np.split(moving, [model.nq], axis=1)
    held = np.repeat(actions, simulator.num_substeps, axis=0)
    held = np.concatenate([held, held[-1:]])  # sysid applies all but the last
    return sysid.SystemTrajectory(
        model,
        sysid.TimeSeries(np.arange(len(held)) * model.opt.timestep, held),
        sysid.TimeSeries(
            np.arange(len(states)) * simulator.step_s,
            moving,
            names[0] | names[1],
        ),
        sysid.create_initial_state(model, positions[0], velocities[0]),
        None,
    )


def _builder(simulator: Simulator, space: ParameterSpace):
    """A function that gives sysid a model of its parameters; it counts the steps."""
    writer = ModelWriter(space, simulator.model)

    @lru_cache(maxsize=2 * len(space) + 2)  # it asks for the same few models at every piece
    def written(values: tuple[float, ...]) -> mujoco.MjModel:
        model = copy.copy(simulator.model)
        writer.write(model, space.from_unit(np.array(values)))
        return model

    def build(parameters: Any, _: mujoco.MjSpec) -> mujoco.MjModel:
        simulator.num_steps += _PIECE_STEPS  # each model that it asks for plays one piece
        return written(tuple(parameters.as_vector()))

    return build


def _residual(num_substeps: int, true_states: np.ndarray, model: mujoco.MjModel):
    """A function that compares states at the ends of policy steps, each by its own spread."""
    moving = StateSpace(model).positions_and_velocities
    spread = moving(true_states).std((0, 1)) + 1e-6

    def compare(_parameters, _predicted, measured, _model, _all, state):
        ends = moving(state[num_substeps - 1 :: num_substeps])
        return (ends - measured.data[1:]) / spread, measured, measured

    return compare
