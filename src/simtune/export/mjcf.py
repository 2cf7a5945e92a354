"""The tuned model as a user's files: MJCF and all that it refers to."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Any

import mujoco
import numpy as np

from simtune.errors import InputError, one_line
from simtune.export.inferred import write_down_inferred
from simtune.parameters import ModelWriter, field_of, rows_of
from simtune.parameters.fields import FIELDS
from simtune.run import write_atomically
from simtune.simulation import count_substeps
from simtune.tasks import Task

_ASSETS = "assets"
_INFERRED = ("body_mass", "body_inertia", "body_ipos", "tendon_lengthspring")


def tuned_model(
    task: Task, parameters: np.ndarray, step_s: float | None
) -> tuple[mujoco.MjSpec, mujoco.MjModel, ModelWriter]:
    """The task's spec, that spec compiled with (N,) `parameters` written into it, and what wrote.

    `step_s`: how long an action lasted in the run; physics steps are a whole part of it.
    """
    step_s = step_s or task.step_s
    spec = task.spec_for(step_s)
    spec.option.timestep = step_s / count_substeps(step_s, spec.option.timestep)
    write_down_inferred(spec)
    model = spec.compile()
    writer = ModelWriter(task.parameters, model)
    writer.write(model, parameters)
    return spec, model, writer


def write_mjcf(
    spec: mujoco.MjSpec, model: mujoco.MjModel, writer: ModelWriter, folder: Path
) -> None:
    """FOLDER/model.xml with the numbers of `model`, which was compiled from `spec`.

    Meshes, textures and height fields from files are copied into FOLDER/assets.
    Raises InputError for a file that cannot be read, or what MuJoCo cannot write, RuntimeError for
    a field that MJCF lacks.
    """
    with _mujocos_errors():
        spec.copy_back(model)
    for kind, name, attribute, value in not_copied(writer, model):
        setattr(getattr(spec, kind)(name), attribute, value)
    _compare(_write(spec, folder), model, {*writer.written, *_INFERRED})


def write_spec(spec: mujoco.MjSpec, folder: Path) -> None:
    """FOLDER/model.xml of a spec as it is, and copies of its files, as `write_mjcf` does it."""
    spec = spec.copy()
    with _mujocos_errors():
        model = spec.compile()
    fields = {name for name in FIELDS if not name.startswith("environment.")}
    _compare(_write(spec, folder), model, fields)


def _write(spec: mujoco.MjSpec, folder: Path) -> mujoco.MjModel:
    """What can be read again from FOLDER/model.xml."""
    copied: dict[Path, str] = {}
    for owner, where, name in _files(spec):
        name = PurePath(name).name if spec.strippath else name
        source = Path(spec.modelfiledir or "") / where / name
        if source not in copied:
            held = spec.assets.get(name)
            copied[source] = _copy(source, folder / _ASSETS, len(copied), held)
        owner.file = copied[source]
    spec.meshdir = spec.texturedir = _ASSETS if copied else ""
    spec.modelfiledir = str(folder)  # writing looks at the files once more
    with _mujocos_errors():
        write_atomically(folder / "model.xml", spec.to_xml().encode())
        return mujoco.MjModel.from_xml_path(str(folder / "model.xml"))


@contextmanager
def _mujocos_errors() -> Iterator[None]:
    """Say them as those of the user's model."""
    try:
        yield
    except ValueError as error:
        raise InputError(f"MuJoCo cannot write the model as MJCF: {one_line(error)}") from error


def not_copied(writer: ModelWriter, model: mujoco.MjModel) -> Iterator[tuple[str, str, str, Any]]:
    """(kind of element, name, attribute, value) of what `copy_back` leaves out of a spec."""
    for field, objects in sorted(writer.written.items()):
        info = field_of(field)
        if not (info.is_not_copied and info.object_type):
            continue
        kind, attribute = info.object_type.name, field.removeprefix(f"{info.prefix}_")
        for name in objects:
            (value,) = info.read(model)[rows_of(model, field, name)].tolist()
            if info.is_delay:  # worth nothing without a memory of controls
                num_samples, interp = model.actuator_history[model.actuator(name).id].tolist()
                yield kind, name, "nsample", num_samples
                yield kind, name, "interp", interp
            yield kind, name, attribute, value


def _compare(reloaded: mujoco.MjModel, model: mujoco.MjModel, fields: set[str]) -> None:
    """MJCF need not have a word for every field of a model."""
    for field in sorted(fields):
        before, after = map(field_of(field).read, (model, reloaded))
        if before.shape != after.shape or not np.allclose(before, after, rtol=1e-4, atol=1e-6):
            raise RuntimeError(f"MuJoCo writes no {field} into MJCF, so it cannot be exported")


def _files(spec: mujoco.MjSpec) -> Iterator[tuple[Any, str, str]]:
    """(what refers to a file, the folder that it is named from, its name)."""
    for where, owners in (
        (spec.meshdir, [*spec.meshes, *spec.hfields, *spec.skins]),
        (spec.texturedir, spec.textures),
    ):
        for owner in owners:
            if owner.file:
                yield owner, where, owner.file


def _copy(source: Path, folder: Path, number: int, held: bytes | None) -> str:
    """The name of the copy, which is the source's own unless that is taken.

    `held`: its content, where it is no file.
    """
    folder.mkdir(exist_ok=True)
    name = PurePath(source).name
    if (folder / name).exists():
        name = f"{number}_{name}"
    try:
        if held is None:
            shutil.copyfile(source, folder / name)
        else:
            (folder / name).write_bytes(held)
    except OSError as error:
        raise InputError(f"cannot copy {source}, which the model needs: {error.strerror}") from None
    return name
