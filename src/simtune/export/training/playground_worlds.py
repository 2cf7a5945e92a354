"""Worlds that simtune found possible, as domain randomisation of a MuJoCo Playground environment.

    from playground_worlds import domain_randomizer

    train(environment=env, randomization_fn=domain_randomizer(env.mj_model), ...)

Each environment gets one of the worlds in worlds.npz, whole: parameters that only show together
vary together. The model's objects must have the same names as those of the one that was tuned.
"""

import copy
import dataclasses
import warnings
from collections.abc import Callable
from pathlib import Path

import jax  # type: ignore[import-not-found]
import mujoco
import numpy as np

from simtune.export.training.rows import rows_of_object

WORLDS = Path(__file__).with_name("worlds.npz")
_ASSETS = ("mesh_", "hfield_", "tex_", "skin_", "bvh_", "oct_")


def domain_randomizer(mj_model: mujoco.MjModel, worlds: Path = WORLDS) -> Callable:
    """A function of (mjx.Model, (E, 2) random keys): the models of E worlds, and their in_axes.

    What MJX has no field for is told, and left out.
    """
    changed = changed_fields(mj_model, worlds)
    with np.load(worlds) as file:
        num, targets = len(file["draws"]), set(file["targets"][:, 0].tolist())

    def domain_randomize(model, rng):
        known = {field.name for field in dataclasses.fields(model)}
        known |= {f"opt.{field.name}" for field in dataclasses.fields(model.opt)}
        if lacking := sorted(targets - known):
            told = f"the same in all worlds, since MJX has no {', '.join(lacking)}"
            warnings.warn(told, stacklevel=2)
        world = jax.vmap(lambda key: jax.random.randint(key, (), 0, num))(rng)
        drawn = {
            field: jax.numpy.asarray(values)[world]
            for field, values in changed.items()
            if field in known
        }
        in_axes = jax.tree_util.tree_map(lambda _: None, model)
        return model.tree_replace(drawn), in_axes.tree_replace(dict.fromkeys(drawn, 0))

    return domain_randomize


def changed_fields(mj_model: mujoco.MjModel, worlds: Path = WORLDS) -> dict[str, np.ndarray]:
    """{field: (worlds, ...) values} of all that differs from the model, derived constants too."""
    with np.load(worlds) as file:
        targets = [tuple(target) for target in file["targets"].tolist()]
        values = [file[f"values_{i}"] for i in range(len(targets))]
    before = _fields(_with_constants(copy.copy(mj_model)))
    changed: dict[str, np.ndarray] = {}
    for world in range(len(values[0])):
        model = copy.copy(mj_model)
        for (field, kind, name), each in zip(targets, values, strict=True):
            if kind == "opt":
                setattr(model.opt, field.removeprefix("opt."), each[world])
            else:
                getattr(model, field)[rows_of_object(model, kind, name)] = each[world]
        for field, after in _fields(_with_constants(model)).items():
            if not np.array_equal(after, before[field]):
                whole = np.repeat(before[field][None], len(values[0]), axis=0)
                changed.setdefault(field, whole)[world] = after
    return changed


def _with_constants(model: mujoco.MjModel) -> mujoco.MjModel:
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _fields(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """What numbers may differ among worlds."""
    owners = {"": model, "opt.": model.opt}
    fields = {
        f"{prefix}{name}": getattr(owner, name)
        for prefix, owner in owners.items()
        for name in dir(owner)
        if not name.startswith(("_", *_ASSETS))
    }
    return {
        name: np.asarray(value)
        for name, value in fields.items()
        if isinstance(value, (float, np.ndarray)) and np.asarray(value).dtype.kind == "f"
    }
