"""Domain randomisation of a MuJoCo Playground environment by worlds that simtune found possible.

    from playground_worlds import domain_randomizer

    train(..., environment=env, randomization_fn=domain_randomizer(env.mj_model))

Each environment gets all parameters of one world in worlds.npz, so correlated parameters vary
together. The model's objects must have the same names as in the tuned model.
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
    """A function that maps (mjx.Model, (E, 2) random keys) to E worlds' models and their in_axes.

    Fields that MJX lacks are left out, with a warning.
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
    """{field: (worlds, ...) values} of fields that differ from the model, and derived constants."""
    with np.load(worlds) as file:
        targets = [tuple(target) for target in file["targets"].tolist()]
        values = [file[f"values_{i}"] for i in range(len(targets))]
    before = _fields(_with_constants(copy.copy(mj_model)))
    changed: dict[str, np.ndarray] = {}
    for world in range(len(values[0])):
        model = copy.copy(mj_model)
        for (field, kind, name), by_world in zip(targets, values, strict=True):
            if kind == "opt":
                setattr(model.opt, field.removeprefix("opt."), by_world[world])
            else:
                getattr(model, field)[rows_of_object(model, kind, name)] = by_world[world]
        for field, after in _fields(_with_constants(model)).items():
            if not np.array_equal(after, before[field]):
                whole = np.repeat(before[field][None], len(values[0]), axis=0)
                changed.setdefault(field, whole)[world] = after
    return changed


def _with_constants(model: mujoco.MjModel) -> mujoco.MjModel:
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _fields(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Fields and options of numbers that may differ among worlds."""
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
