"""Fields and initial states of all simulations of a batch."""

from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.parameters.joint_types import HINGE

_MAX_ATTEMPTS = 1000


def computed(batch: Batch, field: str) -> np.ndarray:
    """(nsim, ...) a position- or velocity-dependent MjData field of the batch's current state."""
    values = batch.bind(field)
    if not values.any():  # a newly bound field is zero until the next computation
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
    return values


def reset_to_default(batch: Batch) -> None:
    """Set the model's default state, time 0 and no controls; derived fields are not computed."""
    batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)


def randomize_joints(batch: Batch, rng: np.random.Generator, ids: np.ndarray) -> None:
    """Draw limited joints uniformly within their limits, and unlimited hinges in [−π, π].

    Unlimited slides stay. Like dm_control.suite.utils.randomizers.
    """
    model = batch.model
    assert model.nq == model.njnt, "only hinges and slides"
    limited = model.jnt_limited == 1
    moved = limited | (model.jnt_type == HINGE)
    low, high = np.where(limited[:, None], model.jnt_range, [-np.pi, np.pi])[moved].T
    batch.qpos[np.ix_(ids, moved)] = rng.uniform(low, high, (len(ids), moved.sum()))


def draw_without_contact(batch: Batch, draw: Callable[[np.ndarray], None]) -> None:
    """Call `draw(ids)` for all simulations, then again for those in contact, until none is.

    Raises RuntimeError after too many attempts.
    """
    ncon = batch.bind("ncon")
    ids = np.arange(batch.nsim)
    for _ in range(_MAX_ATTEMPTS):
        draw(ids)
        batch.forward(ids, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        ids = ids[ncon[ids] > 0]
        if not ids.size:
            return
    raise RuntimeError(f"no state without contacts after {_MAX_ATTEMPTS} attempts")
