"""Many worlds of one model, each with its own parameters, stepped at once (mujoco.batch)."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.parameters import ModelWriter, ParameterSpace

_DIVERGENCE = [  # counters of MuJoCo's warnings
    mujoco.mjtWarning.mjWARN_BADQPOS.value,
    mujoco.mjtWarning.mjWARN_BADQVEL.value,
    mujoco.mjtWarning.mjWARN_BADQACC.value,
]
_WITH_VELOCITIES = mujoco.mjtStage.mjSTAGE_VEL.value


class Worlds:
    """`num_worlds` simulations of `model`, each with a vector of `space`'s parameters.

    A world whose physics diverges (NaN or huge values) is dead until the next `reset`: MuJoCo's
    silent reset is off, and `alive` says which worlds may be used.
    """

    def __init__(self, model: mujoco.MjModel, space: ParameterSpace, num_worlds: int):
        model = copy.copy(model)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.batch = Batch(model, num_worlds)
        self._writer = ModelWriter(space, model)

    @property
    def state(self) -> np.ndarray:
        """(num_worlds, S) the worlds' full states; live, not a copy."""
        return self.batch.state

    @property
    def alive(self) -> np.ndarray:
        """(num_worlds,) bool: the physics has stayed finite since the last reset."""
        finite = np.isfinite(self.batch.state).all(axis=1)
        return finite & (self.batch.warning[:, _DIVERGENCE, 1] == 0).all(axis=1)

    def reset(self, parameters: np.ndarray, initialize, rng: np.random.Generator) -> None:
        """Write (num_worlds, N) parameters and start anew by `initialize(batch, rng)`."""
        self._writer.write_batch(self.batch, parameters)
        with no_printed_warnings():
            self.batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
            initialize(self.batch, rng)
            self.batch.forward(stage=_WITH_VELOCITIES)

    def step(self, controls: np.ndarray, num_substeps: int) -> None:
        """Hold (num_worlds, nu) controls for a number of physics steps."""
        alive = self.alive
        self.batch.ctrl[...] = controls
        with no_printed_warnings():
            ids = None if alive.all() else alive
            self.batch.step(ids=ids, nstep=num_substeps, stage=_WITH_VELOCITIES)


@contextmanager
def no_printed_warnings() -> Iterator[None]:
    """Keep MuJoCo from writing lines to stderr for diverged worlds; they are counted."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
