"""What no sensor measures, such as a lid that a robot lifts: where it is when a stretch begins.

It began as each simulated episode does, and what it did since follows from a replay. `carried`
replays an episode with all measured joints put back where they were read, row by row. So what was
pushed goes along whatever the parameters are, but it bounces as coarsely as readings tell speeds.
`play_in_turn` goes on from the replay of the stretches before, which is as good as the parameters,
and derivatives by these know that a stronger servo pushes farther.
"""

from collections.abc import Callable, Collection, Sequence

import mujoco
import numpy as np

from simtune.fit.physics import Physics
from simtune.fit.readings.segments import Stretches, steps_until_next
from simtune.observation import JointSensor
from simtune.simulation.joints import joints_of_state
from simtune.simulation.ties import dofs_of_ties

# (n) stretches, (G, n, nq + nv) initial states, (G, N) units and (n,) steps: predictions, first
# full states, and (G, n, nq + nv) states after these steps
PlayApart = Callable[
    [Stretches, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]
]


def what_goes_on(
    model: mujoco.MjModel, sensors: Sequence[JointSensor], untouched: Collection[int] = ()
) -> np.ndarray:
    """(nq + nv,) bool: what no sensor measures, not even through a tie, and something may touch.

    What robots push goes on as it was pushed, while readings begin anew what they tell: a play that
    goes on would be added to a reading behind it. `untouched`: joints of objects out of reach.
    """
    told, speeds, ties = set[int](), list[int](), list(dofs_of_ties(model).values())
    for sensor in sensors:
        if sensor.is_torque:
            continue
        read = [*sensor.places.tolist(), *sensor.play_places.tolist()]
        if sensor.is_velocity:  # perhaps of joints whose positions are not measured
            speeds += read
        else:
            told.update(model.jnt_dofadr[np.searchsorted(model.jnt_qposadr, read)].tolist())
    for _ in ties:  # a chain may be written in any order
        told = told.union(*(tie for tie in ties if tie & told))
    known = [*model.dof_jntid[list(told)], *untouched]
    found = ~np.isin(joints_of_state(model), known)
    found[model.nq + np.array(speeds, int)] = False
    return found


def carried(
    physics: Physics,
    states: np.ndarray,
    actions: np.ndarray,
    actuator_states: np.ndarray,
    unit: np.ndarray,
    goes_on: np.ndarray,
) -> np.ndarray:
    """(E, T + 1, nq + nv) states as read, with what `goes_on`, (nq + nv,) bool, as it was carried.

    In worlds of (N,) parameters in unit coordinates, with (E, K, A) actions, the first K ≤ T, and
    (E, T + 1, S) `actuator_states` of `Physics.replay_actuators`.
    """
    states, units = states.copy(), np.repeat(unit[None], len(states), 0)
    for t in range(actions.shape[1]):
        played, _ = physics.play(states[:, t], units, actions[:, t : t + 1], actuator_states[:, t])
        after = physics.states(played[:, 1])
        states[:, t + 1] = np.where(goes_on, after, states[:, t + 1])
    return states


def play_in_turn(
    play_apart: PlayApart,
    stretches: Stretches,
    states: np.ndarray,
    units: np.ndarray,
    goes_on: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """As `OpenLoopReplay.play`: the first stretch of each episode, then the second, and so on."""
    episode, begin = stretches.episode, stretches.begin
    assert begin is not None, "stretches that go on are cut of episodes"
    until, states = steps_until_next(episode, begin), states.copy()
    turns = np.arange(len(episode)) - np.searchsorted(episode, episode)
    groups, num = states.shape[:2]
    rows, readings = stretches.values.shape[1:]
    predicted = np.empty((groups, num, rows, readings))
    first = np.empty((groups, num, stretches.actuator_states.shape[-1]))
    for turn in range(turns.max() + 1):
        its = np.flatnonzero(turns == turn)
        part, leads = stretches.of(its), until[its] > 0
        part = part.first(max(part.longest, until[its].max()))
        seen, first[:, its], then = play_apart(part, states[:, its], units, until[its])
        predicted[:, its] = seen[:, :, np.minimum(np.arange(rows), seen.shape[2] - 1)]
        after = its[leads] + 1
        states[:, after] = np.where(goes_on, then[:, leads], states[:, after])
    return predicted, first
