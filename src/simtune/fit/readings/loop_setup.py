"""How an open-loop replay is set up: where that begins which no sensor measures."""

from dataclasses import replace

import numpy as np

from simtune.fit.physics import Physics, is_lost
from simtune.fit.readings.measured_states import MeasuredStates
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.readings import Readings
from simtune.observation import ObservationModel, assumed_noise, measured_places
from simtune.simulation import AnySimulator, Simulator
from simtune.simulation.loose_objects import gliding_joints, loose_joints

_FAR_IN_EXTENTS = 1e3  # of the model
_TRIED_EPISODES = 3
_SMALL_TRAVEL_SHARE = 0.02  # of how far readings travel


def set_up_loop(
    simulator: AnySimulator, observation: ObservationModel, start: np.ndarray
) -> OpenLoopReplay:
    """What replays readings in a simulator; `start`: (N,) parameters of an initial world.

    Positions that no sensor measures begin as in a simulated episode of that world; but objects
    that begin anywhere are put where nothing touches them, or touch nothing. Derivatives are by
    parameters that affect motion.
    """
    assert isinstance(simulator, Simulator), "sensors measure a model's joints"
    still, rng = np.zeros((2, 1, simulator.num_actions)), np.random.default_rng(0)
    begun = simulator.roll_out(np.repeat(start[None], 2, 0), still, rng, keep_diverged=True)
    sensors, space = observation.sensors, simulator.state_space
    state, another = space.positions_and_velocities(begun.states[:, 0])
    differs, model, untouched = state != another, simulator.model, list[int]()
    for number, joint in enumerate(loose_joints(model).tolist()):
        place = model.jnt_qposadr[joint]
        if differs[place : place + 3].any():
            state[place] += (1 + number) * _FAR_IN_EXTENTS * model.stat.extent
            untouched.append(joint)
    full_state = space.with_positions_and_velocities(begun.states[0, 0], state)
    places = measured_places(sensors)
    gliding = gliding_joints(model, places)
    if differs[model.jnt_qposadr[gliding]].any():
        trees = model.body_treeid[model.jnt_bodyid[gliding]]
        simulator = simulator.without_contacts(np.isin(model.body_treeid, trees))
        untouched += gliding.tolist()
    physics = Physics(simulator, observation.observe_beside(), full_state)
    measured = MeasuredStates(physics, sensors, untouched)
    is_known = np.pad(measured.is_loose_position, (0, model.nv), constant_values=True)
    is_known[places] = True
    fitted = np.flatnonzero(~simulator.space.is_appearance)
    elsewhere = np.where(differs & ~is_known, another, np.nan)
    return OpenLoopReplay(
        measured, fitted, is_simulated=observation.is_simulated, elsewhere=elsewhere
    )


def where_starts_show(loop: OpenLoopReplay, readings: Readings, unit: np.ndarray) -> OpenLoopReplay:
    """The same loop, but with nothing unseen if no reading shows where it begins.

    Wheels turn alike wherever on a floor their robot begins. Two such starts are played in a
    world of (N,) `unit` coordinates; what readings show is more than their usual noise and two
    percent of their travel: wheels differ that bounce a little, and pyramids of friction have
    edges. If one diverges, nobody knows.
    """
    if loop.elsewhere is None or not loop.unseen:
        return loop
    stretches = loop.cut(readings.first(episodes=_TRIED_EPISODES), unit)
    moved = np.where(np.isnan(loop.elsewhere), stretches.states, loop.elsewhere)
    moved = loop.measured.bases.begun(moved, unit[: len(loop.physics.parameters)])  # another way
    both = np.stack([stretches.states, moved])
    predicted, _ = loop.play(stretches, both, np.repeat(unit[None], 2, 0))
    little = assumed_noise(loop.sensors) + _SMALL_TRAVEL_SHARE * stretches.travel[:, None]
    shows = np.abs(predicted[1] - predicted[0]) > little
    may_show = shows.any() or is_lost(predicted).any()
    return loop if may_show else replace(loop, elsewhere=None)
