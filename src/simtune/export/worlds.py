"""Draws from a run's joint posterior, in a format for training with other libraries."""

import copy
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.export.script import is_nameless
from simtune.export.training import module_text
from simtune.names import ExportFormat
from simtune.parameters import ModelWriter, ParameterSpace, field_of, rows_of
from simtune.run.files import write_atomically


def refuse_unfit(space: ParameterSpace, library: ExportFormat) -> None:
    """Raises InputError if a parameter has an unnamed object, or cannot differ among worlds."""
    for parameter in space:
        if nameless := [name for name in parameter.objects if is_nameless(name)]:
            raise InputError(
                f"{parameter.name} is of {nameless[0]}, which has no name to find it by in another "
                "model: give it one in the model, and tune that"
            )
        if library == "mjlab" and parameter.field_info.is_option:
            raise InputError(
                f"mjlab has one {parameter.field} for all worlds, so {parameter.name} cannot be "
                "randomised there: --format playground can"
            )


def write_module(folder: Path, library: ExportFormat) -> None:
    """Write FOLDER/LIBRARY_worlds.py, which randomises environments with worlds.npz beside it."""
    write_atomically(folder / f"{library}_worlds.py", module_text(library).encode())


def write_worlds(path: Path, writer: ModelWriter, model: mujoco.MjModel, draws: np.ndarray) -> None:
    """Write (W, N) draws, and the model's values for each, as NPZ.

    `names` (N,) and `draws` (W, N); `targets` (M, 3): a field of MjModel, the kind and the name of
    an object; `values_0` to `values_M-1`, each (W, rows, ...): the object's values of the field.
    """
    targets = list(_targets(writer))
    values: list[list[np.ndarray]] = [[] for _ in targets]
    world = copy.copy(model)
    for draw in draws:
        writer.write(world, draw)
        for (field, _, name), target_values in zip(targets, values, strict=True):
            info = field_of(field)
            rows = ... if info.is_option else rows_of(world, field, name)
            target_values.append(np.array(info.read(world)[rows]))
    file = io.BytesIO()
    arrays: dict[str, Any] = {f"values_{i}": np.array(v) for i, v in enumerate(values)}
    arrays |= {"names": np.array(writer.space.names), "draws": draws, "targets": np.array(targets)}
    np.savez_compressed(file, **arrays)
    write_atomically(path, file.getvalue())


def _targets(writer: ModelWriter) -> Iterator[tuple[str, str, str]]:
    """(field, kind of object, its name) of everything written; the name is "" for an option."""
    for field, objects in writer.written.items():
        for name in objects or [""]:
            yield field, field_of(field).prefix, name
