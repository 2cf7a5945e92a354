"""Domain randomisation of an mjlab environment by worlds that simtune found possible.

    from mjlab_worlds import tuned_worlds

    cfg.events["tuned_worlds"] = tuned_worlds(prefix="robot/")

Each environment gets all parameters of one world in worlds.npz, so correlated parameters vary
together. `prefix` is the entity's name in the scene; its objects must have the same names as in the
tuned model. Fields that mjlab lacks are left out, with a warning.
"""

import warnings
from dataclasses import fields
from pathlib import Path

import mujoco
import mujoco_warp
import numpy as np
import torch
from mjlab.managers.event_manager import (  # type: ignore[import-not-found]
    EventTermCfg,
    RecomputeLevel,
    requires_model_fields,
)

from simtune.export.training.rows import rows_of_object

WORLDS = Path(__file__).with_name("worlds.npz")


def tuned_worlds(prefix: str, mode: str = "startup", worlds: Path = WORLDS) -> EventTermCfg:
    """An event that draws a world for each environment, once ("startup") or at every "reset"."""
    with np.load(worlds) as file:
        num = len(file["draws"])
        found = [
            (*target, torch.from_numpy(file[f"values_{i}"]))
            for i, target in enumerate(file["targets"].tolist())
        ]
    known = {field.name for field in fields(mujoco_warp.Model)}
    if lacking := sorted({field for field, *_ in found} - known):
        warnings.warn(
            f"the same in all worlds, since mjlab has no {', '.join(lacking)}", stacklevel=2
        )
    found = [target for target in found if target[0] in known]

    @requires_model_fields(*(field for field, *_ in found), recompute=RecomputeLevel.set_const)
    def draw(env, env_ids):
        if env_ids is None:
            env_ids = torch.arange(env.num_envs, device=env.device)
        model: mujoco.MjModel = env.sim.mj_model
        world = torch.randint(num, (len(env_ids),))
        for field, kind, name, values in found:
            rows = rows_of_object(model, kind, prefix + name)
            array = getattr(env.sim.model, field)  # (E, objects, ...)
            at = env_ids[:, None], torch.from_numpy(rows).to(env.device)
            array[at] = values[world].to(env.device, array.dtype)

    return EventTermCfg(mode=mode, func=draw)
