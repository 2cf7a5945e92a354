"""What the arms do: one after the other looks where the box is, and pushes it.

A push is quick and ends short, so that the box slides on: how far it slides tells its friction. The
commands are those of an operator who watches the arm: dry friction keeps a hand up to several
centimetres above where it is sent, so he corrects them by what the joints lacked the time before.
"""

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.optimize import least_squares

from simtune.simulation import Simulator

_SIDES = ("left", "right")
_JOINTS = 6  # of an arm
_WAIST, _SHOULDER, _ELBOW = 0, 1, 2
_ATTEMPTS = 3
# Of a push, in shares of its time: the arm turns, goes down, waits, pushes, stays, and goes home.
_TURNED, _DOWN, _READY, _UP = 0.25, 0.5, 0.55, 0.85
_PUSHED = (0.60, 0.63)
_POWER = 1.5  # of time, as which a push proceeds: it is quickest when it ends
_BEFORE_RAD, _BEYOND_RAD = (0.16, 0.22), (0.0, 0.05)  # of the waist, from where the box is
_REACH_M, _BESIDE_M = (0.42, 0.56), 0.012  # from the arm's base; of the hand, from the box
_HEIGHT_M = 0.018  # of the hand: the fingers' ends are lower by 6 mm
_WOBBLE_RAD, _WOBBLE_HZ = (0.05, 0.15), (0.4, 1.6)


class Pushed(NamedTuple):
    """An episode."""

    start: np.ndarray  # (S,) state
    actions: np.ndarray  # (T, A)


@dataclass(frozen=True)
class Operator:
    """Who commands both arms of a world, which follow `delay_steps` late."""

    simulator: Simulator
    parameters: np.ndarray  # (N,)
    step_s: float
    delay_steps: int
    rng: np.random.Generator

    def push(self, steps: int) -> Pushed:
        """An episode in which each arm in turn pushes the box, in half of the time each."""
        nothing = np.zeros((0, self.simulator.num_actions))
        start = self._play(None, nothing)[-1]
        states, actions = start[None], nothing
        for turn, side in enumerate(self.rng.permutation(2)):
            num = steps // 2 if turn == 0 else steps - steps // 2
            actions = np.concatenate([actions, self._push(side, num, start, actions, states[-1])])
            states = self._play(start, actions)
        return Pushed(start, actions)

    def late(self, actions: np.ndarray) -> np.ndarray:
        """(T, A) what the arms are told at each step."""
        return actions[np.maximum(np.arange(len(actions)) - self.delay_steps, 0)]

    def _push(
        self, side: int, steps: int, start: np.ndarray, before: np.ndarray, state: np.ndarray
    ) -> np.ndarray:
        """(steps, A) commands to go on with after those `before`, which lead to `state`."""
        arm, low = _JOINTS * side, _lowered(steps)
        wanted = self._wanted(side, steps, self._positions(state)[-7:-5])
        shaking = np.ones_like(wanted)
        shaking[:, arm : arm + _JOINTS] = 1 - low[:, None]  # a low hand would hit the table
        wanted += shaking * self._wobble(steps)
        commands = wanted.copy()
        for _ in range(_ATTEMPTS):
            played = self._play(start, np.concatenate([before, commands]))
            reached = self._positions(played[len(before) : -1])
            for joint in (arm + _SHOULDER, arm + _ELBOW):
                lacks = wanted[:, joint] - reached[:, joint]
                commands[:, joint] += low * lacks[low == 1].mean()
        return commands

    def _wanted(self, side: int, steps: int, box: np.ndarray) -> np.ndarray:
        """(steps, A) angles: over to one side of the (2,) box, down, through it, and home."""
        rng, home, arm = self.rng, self._home, _JOINTS * side
        away = (box - self.simulator.model.body(f"vx300s_{_SIDES[side]}").pos[:2]) * (1 - 2 * side)
        reach = np.clip(np.hypot(*away) + rng.uniform(-_BESIDE_M, _BESIDE_M), *_REACH_M)
        at = np.arctan2(away[1], away[0])
        inwards = -1.0 if at > 0 else 1.0
        begin = at - inwards * rng.uniform(*_BEFORE_RAD)
        end = at + inwards * rng.uniform(*_BEYOND_RAD)
        share, pushed = np.linspace(0, 1, steps), rng.uniform(*_PUSHED)
        angles = np.tile(home, (steps, 1))
        angles[:, arm] += (begin - home[arm]) * _eased(share, 0, _TURNED)
        done = np.clip((share - _READY) / (pushed - _READY), 0, 1)
        angles[:, arm] += (end - begin) * done**_POWER
        angles[:, arm] += (home[arm] - end) * _eased(share, _UP, 1)
        low = self._reach(_SIDES[side], float(reach))
        for joint, angle in zip((arm + _SHOULDER, arm + _ELBOW), low, strict=True):
            angles[:, joint] += (angle - home[joint]) * _lowered(steps)
        return angles

    def _wobble(self, steps: int) -> np.ndarray:
        """(steps, A) of all joints, whatever they do besides."""
        size = self.rng.uniform(*_WOBBLE_RAD, len(self._home))
        hertz = self.rng.uniform(*_WOBBLE_HZ, len(self._home))
        phase = self.rng.uniform(0, 2 * np.pi, len(self._home))
        seconds = np.arange(steps)[:, None] * self.step_s
        return size * np.sin(2 * np.pi * hertz * seconds + phase)

    @property
    def _home(self) -> np.ndarray:
        return self.simulator.model.key_qpos[0][: self.simulator.num_actions]

    def _positions(self, states: np.ndarray) -> np.ndarray:
        space = self.simulator.state_space
        return space.positions_and_velocities(states)[..., : self.simulator.model.nq]

    def _play(self, start: np.ndarray | None, actions: np.ndarray) -> np.ndarray:
        """(T + 1, S) states; from a start drawn anew where there is none."""
        starts = None if start is None else start[None]
        played = self.simulator.roll_out(
            self.parameters[None], self.late(actions)[None], self.rng, starts=starts
        )
        return played.states[0]

    def _reach(self, side: str, reach_m: float) -> np.ndarray:
        """(2,) angles of shoulder and elbow that bring the hand down to the table, so far away."""
        model = self.simulator.model
        data, site = mujoco.MjData(model), model.site(f"cali_{side}_site1").id
        first = model.jnt_qposadr[model.joint(f"vx300s_{side}/shoulder").id]
        base = model.body(f"vx300s_{side}").pos

        def away(angles: np.ndarray) -> list[float]:
            data.qpos[:] = model.key_qpos[0]
            data.qpos[first : first + 2] = angles
            mujoco.mj_kinematics(model, data)
            x, y, z = data.site_xpos[site] - base
            return [np.hypot(x, y) - reach_m, z - _HEIGHT_M]

        return least_squares(away, model.key_qpos[0][first : first + 2]).x


def _lowered(steps: int) -> np.ndarray:
    """(steps,) how far the hand is down, from 0 to 1."""
    share = np.linspace(0, 1, steps)
    return np.minimum(_eased(share, _TURNED, _DOWN), 1 - _eased(share, _UP, 1))


def _eased(share: np.ndarray, begin: float, end: float) -> np.ndarray:
    """0 before, 1 after, and smoothly from one to the other."""
    done = np.clip((share - begin) / (end - begin), 0, 1)
    return done**2 * (3 - 2 * done)
