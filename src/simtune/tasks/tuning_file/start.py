"""Initial states of a user's model: a pose, and random changes of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.errors import InputError
from simtune.simulation.held_controls import HeldControls
from simtune.simulation.states import turned_about_vertical

_MAX_ATTEMPTS = 300
_POS = mujoco.mjtStage.mjSTAGE_POS.value


@dataclass(frozen=True)
class Spread:
    """A component of qpos or qvel that is drawn uniformly between low and high."""

    index: int
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Start:
    """Sets the initial states of a batch; used as a task's `initialize`.

    Objects that start inside others would be thrown out. So positions are drawn until there are no
    more contacts than in the pose itself, unless things `may_touch`. Raises InputError if no such
    state is found.
    """

    where: str  # place in the user's file, for messages
    keyframe: int = -1  # -1: the model's default state
    positions: Sequence[Spread] = ()
    # Rotations of free joints about the world's z, rad; the index is that of the quaternion
    turns: Sequence[Spread] = ()
    velocities: Sequence[Spread] = ()
    may_touch: bool = False

    def __call__(self, batch: Batch, rng: np.random.Generator) -> None:
        batch.reset(keyframe=self.keyframe, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        if self.keyframe < 0:  # the nominal qpos0, where encoders are 0 for any joint_offset
            batch.qpos[...] = batch.model.qpos0
        if self.positions or self.turns:
            self._draw_positions(batch, rng)
        for spread in self.velocities:
            batch.qvel[:, spread.index] = rng.uniform(spread.low, spread.high, batch.nsim)
        batch.forward()

    def _draw_positions(self, batch: Batch, rng: np.random.Generator) -> None:
        num_contacts, pose = batch.bind("ncon"), batch.qpos.copy()
        held = HeldControls(batch.model)
        held.holding(batch)  # binds what it reads
        batch.forward(stage=_POS)
        allowed, ids, before = num_contacts.copy(), np.arange(batch.nsim), held.holding(batch)
        for _ in range(_MAX_ATTEMPTS):
            for spread in self.positions:
                batch.qpos[ids, spread.index] = rng.uniform(spread.low, spread.high, len(ids))
            for spread in self.turns:
                angle = rng.uniform(spread.low, spread.high, len(ids))
                quaternion = slice(spread.index, spread.index + 4)
                turned = turned_about_vertical(pose[ids, quaternion], angle)
                batch.qpos[ids, quaternion] = turned
            batch.forward(ids, stage=_POS)
            ids = ids[num_contacts[ids] > allowed[ids]]
            if self.may_touch or not ids.size:
                held.follow(batch, before)
                return
        raise InputError(
            f"{self.where}: in each of {_MAX_ATTEMPTS} starts drawn, things touch that do not in "
            "the pose drawn around: narrow [initial_state.joints], or say may_touch = true"
        )
