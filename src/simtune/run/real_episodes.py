"""real/NNN.safetensors: trajectories that a training filmed, which cannot be filmed again."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import safetensors.torch
import torch

from simtune.errors import InputError
from simtune.networks.layers import under
from simtune.run.files import write_atomically
from simtune.trajectory import Trajectory


def write_real(run: Path, cycle: int, trajectories: Sequence[Trajectory]) -> None:
    """Store a cycle's real trajectories in a run's folder."""
    tensors = {}
    for i, trajectory in enumerate(trajectories):
        tensors[f"{i}.frames"] = torch.from_numpy(np.ascontiguousarray(trajectory.frames))
        tensors[f"{i}.actions"] = torch.from_numpy(np.ascontiguousarray(trajectory.actions))
        for name, values in trajectory.readings.items():
            tensors[f"{i}.readings.{name}"] = torch.from_numpy(np.ascontiguousarray(values))
    (run / "real").mkdir(exist_ok=True)
    write_atomically(_file(run, cycle), safetensors.torch.save(tensors))


def read_real(run: Path, cycle: int, step_s: float) -> list[Trajectory]:
    """The inverse of `write_real`. Raises InputError if the file is damaged."""
    path = _file(run, cycle)
    try:
        tensors = safetensors.torch.load_file(path)
    except (OSError, safetensors.SafetensorError) as error:
        raise InputError(
            f"{path} is damaged ({error}), and what it showed cannot be filmed again: "
            "give another --out to start anew"
        ) from None
    count = sum(name.split(".")[1:] == ["actions"] for name in tensors)
    return [_trajectory(under(f"{i}.", tensors), step_s) for i in range(count)]


def _file(run: Path, cycle: int) -> Path:
    return run / "real" / f"{cycle:03d}.safetensors"


def _trajectory(tensors: Mapping[str, torch.Tensor], step_s: float) -> Trajectory:
    readings = {name: values.numpy() for name, values in under("readings.", tensors).items()}
    return Trajectory(tensors["frames"].numpy(), tensors["actions"].numpy(), step_s, readings)
