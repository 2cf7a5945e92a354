"""The table [policy] of a tuning file: reward and success, for training a policy."""

import itertools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.errors import InputError, UnknownName, blame
from simtune.parameters.joint_types import HINGE_OR_SLIDE
from simtune.tasks.batch_state import computed
from simtune.tasks.tuning_file.object_names import find_objects
from simtune.tasks.tuning_file.user_code import load_user_code
from simtune.toml_reading import TomlTable

_GOALS = ("reward", "success")
_KEYS = (*_GOALS, "success_steps", "steps", "free_joints", "symmetric_hinges")


class WorldsData:
    """Argument of a user's reward: MjData of n worlds, and `model`.

    The first axis of each field is the worlds: `qpos` is (n, nq), `xpos` is (n, nbody, 3).
    """

    def __init__(self, batch: Batch):
        self._batch, self.model = batch, batch.model

    def __getattr__(self, field: str) -> np.ndarray:
        try:
            values = computed(self._batch, field).view()
        except ValueError as error:
            raise AttributeError(str(error)) from None
        values.flags.writeable = False  # this is the simulation's own memory
        return values


def read_policy(table: TomlTable, model: mujoco.MjModel, episode_steps: int) -> dict[str, Any]:
    """Fields of a `Task`; none for an empty table.

    Raises InputError if the table is invalid or does not fit the model.
    """
    table.allow(*_KEYS)
    if table.is_empty:
        return {}
    policy: dict[str, Any] = {"declared_policy": table.content()}
    worlds = _some_worlds(model)
    for goal in _GOALS:
        if goal == "reward" or goal in table:
            named = table.text(goal)
            with table.at(goal):
                function, source = load_user_code(table.file.parent, named)
                policy[goal] = _of_worlds(named, function, is_boolean=goal == "success")
                if not np.isfinite(policy[goal](worlds)).all():
                    raise InputError(f"{named} gives no finite number where the model starts")
            policy["declared_policy"] += source
    if "success_steps" in table:
        policy["goal_steps"] = _success_steps(table, episode_steps)
    if "steps" in table:
        policy["policy_steps"] = table.whole("steps")
    with table.at("free_joints"):
        policy["free_joints"] = find_objects(model, "joint", table.names("free_joints", ()))
    hinges = table.table("symmetric_hinges")
    policy["symmetric_hinges"] = {name: hinges.whole(name, least=2) for name in hinges}
    known = [model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] in HINGE_OR_SLIDE]
    for where, names in ((table, policy["free_joints"]), (hinges, policy["symmetric_hinges"])):
        for name in names:
            if name not in known:
                raise where.error(UnknownName("hinge or slide", name, "the model", known))
    return policy


def _success_steps(table: TomlTable, episode_steps: int) -> int:
    steps = table.whole("success_steps")
    with table.at("success_steps"):
        if "success" not in table:
            raise InputError("success_steps needs success, whose time it limits")
        if steps > episode_steps:
            raise InputError(
                f"success_steps must be at most an episode's {episode_steps} steps, got {steps}"
            )
    return steps


def _of_worlds(
    named: str, function: Callable[..., Any], *, is_boolean: bool
) -> Callable[[Batch], np.ndarray]:
    """The user's function, applied to a batch. Raises InputError if it fails."""

    def call(batch: Batch) -> np.ndarray:
        with blame(f"{named} failed"):
            values = np.asarray(function(WorldsData(batch)), float)
        if values.shape != (batch.nsim,):
            raise InputError(
                f"{named} must give a number for each world, here an array of shape "
                f"({batch.nsim},), got {values.shape}"
            )
        if is_boolean and not (is_either := np.isin(values, (0, 1))).all():
            raise InputError(
                f"{named} must give true or false for each world, got {values[~is_either][0]:.6g}"
            )
        return values

    return call


def _some_worlds(model: mujoco.MjModel) -> Batch:
    """A batch in the default state.

    The number of worlds differs from all sizes of the model, so that a function that confuses the
    axes is noticed.
    """
    counts = (getattr(model, name) for name in dir(model) if name.startswith("n"))
    sizes = {size for size in counts if isinstance(size, int)}
    batch = Batch(model, next(n for n in itertools.count(11) if n not in sizes), 1)
    batch.forward()
    return batch
