"""Writes the tuned model as MJCF, with all files that it refers to."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePath
from typing import Any

import mujoco
import numpy as np

from simtune.errors import InputError, one_line
from simtune.export.round_trip import compare
from simtune.parameters import ModelWriter, field_of, rows_of
from simtune.parameters.fields import FIELDS
from simtune.parameters.inferred import let_inertias_be_rounded, write_down_inferred
from simtune.run.files import write_atomically
from simtune.simulation import count_substeps
from simtune.tasks import Task

_ASSETS = "assets"
_IMPOSSIBLE = 1e-4  # relative: as much as the written model may differ
_SPEC_NAMES = {"geom_fluid": "fluid_coefs"}  # where MjSpec's name is not MjModel's
_INFERRED = (
    *("body_mass", "body_inertia", "body_ipos", "tendon_lengthspring"),
    *("jnt_stiffness", "dof_damping"),
    *(f"actuator_{what}" for what in ("biasprm", "lengthrange", "ctrlrange", "actrange")),
)


def tuned_model(
    task: Task, parameters: np.ndarray, step_s: float | None
) -> tuple[mujoco.MjSpec, mujoco.MjModel, ModelWriter]:
    """The task's spec, the compiled model with (N,) `parameters`, and the writer of the latter.

    `step_s`: duration of an action in the run, which is a multiple of the physics timestep.
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
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    writer: ModelWriter,
    folder: Path,
    files: Sequence[Path],
) -> None:
    """Write FOLDER/model.xml with the numbers of `model`, which was compiled from `spec`.

    Files of meshes, textures and height fields are copied into FOLDER/assets. `files`: where those
    of attached models may lie, whose folders a spec does not tell. Raises InputError if a file
    cannot be read, MuJoCo cannot write the model, or no body has its inertias; RuntimeError for a
    field that MJCF lacks.
    """
    _check_inertias(model)
    with _mujocos_errors():
        spec.copy_back(model)
    for kind, name, attribute, value in not_copied(writer, model):
        setattr(getattr(spec, kind)(name), attribute, value)
    if "qpos0" in writer.written:  # which keyframes without a qpos would follow
        for key, qpos in zip(spec.keys, model.key_qpos, strict=True):
            key.qpos = qpos
    compare(_write(spec, folder, files), model, {*writer.written, *_INFERRED})


def _check_inertias(model: mujoco.MjModel) -> None:
    """Raises InputError for those of no rigid body, which MuJoCo plays but does not read."""
    least, middle, most = np.sort(model.body_inertia, axis=1).T
    for body in np.flatnonzero(most > (1 + _IMPOSSIBLE) * (least + middle)):
        a, b, c = model.body_inertia[body]
        raise InputError(
            f"the inertias found of {model.body(body).name}, {a:.3g}, {b:.3g} and {c:.3g} kg·m², "
            "are no body's: one is above the sum of the other two. The model lacks something, or "
            "they are hardly told: weigh the body, or give narrower low and high"
        )


def write_spec(spec: mujoco.MjSpec, folder: Path) -> None:
    """Write an unchanged spec as FOLDER/model.xml, with copies of its files, like `write_mjcf`."""
    spec = spec.copy()
    with _mujocos_errors():
        model = spec.compile()
    fields = {name for name in FIELDS if not name.startswith("environment.")}
    compare(_write(spec, folder, ()), model, fields)


def _write(spec: mujoco.MjSpec, folder: Path, files: Sequence[Path]) -> mujoco.MjModel:
    """Write FOLDER/model.xml and copies of its files; returns the model read from there."""
    let_inertias_be_rounded(spec)
    copied: dict[Path, str] = {}
    for rename, where, name in _files(spec):
        name = PurePath(name).name if spec.strippath else name
        held = _held(spec, where, name)
        source = Path(spec.modelfiledir or "") / where / name
        if held is None and not source.is_file():
            source = _of_attached(name, files) or source
        if source not in copied:
            copied[source] = _copy(source, folder / _ASSETS, len(copied), held)
        rename(copied[source])
    spec.meshdir = spec.texturedir = _ASSETS if copied else ""
    spec.modelfiledir = str(folder)  # MuJoCo reads the files again when writing
    with _mujocos_errors():
        write_atomically(folder / "model.xml", spec.to_xml().encode())
        return mujoco.MjModel.from_xml_path(str(folder / "model.xml"))


@contextmanager
def _mujocos_errors() -> Iterator[None]:
    """Turn MuJoCo's ValueErrors into InputErrors about the user's model."""
    try:
        yield
    except ValueError as error:
        raise InputError(f"MuJoCo cannot write the model as MJCF: {one_line(error)}") from error


def not_copied(writer: ModelWriter, model: mujoco.MjModel) -> Iterator[tuple[str, str, str, Any]]:
    """(kind of element, name, attribute, value) of values that `copy_back` omits."""
    for field, objects in sorted(writer.written.items()):
        info = field_of(field)
        if not (info.is_not_copied and info.object_type):
            continue
        kind = info.object_type.name
        attribute = _SPEC_NAMES.get(field, field.removeprefix(f"{info.prefix}_"))
        for name in objects:
            (value,) = info.read(model)[rows_of(model, field, name)].tolist()
            if info.is_delay:  # has no effect without a memory of controls
                num_samples, interp = model.actuator_history[model.actuator(name).id].tolist()
                yield kind, name, "nsample", num_samples
                yield kind, name, "interp", interp
            yield kind, name, attribute, [value[i] for i in info.components or ()] or value


def _files(spec: mujoco.MjSpec) -> Iterator[tuple[Callable[[str], None], str, str]]:
    """(function that renames the file in the spec, folder to which the name is relative, name)."""
    for where, owners in (
        (spec.meshdir, [*spec.meshes, *spec.hfields, *spec.skins]),
        (spec.texturedir, spec.textures),
    ):
        for owner in owners:
            if owner.file:
                yield partial(setattr, owner, "file"), where, owner.file
    for texture in spec.textures:
        for side, name in enumerate(texture.cubefiles):
            if name:
                yield partial(texture.cubefiles.__setitem__, side), spec.texturedir, name


def _held(spec: mujoco.MjSpec, where: str, name: str) -> bytes | None:
    """The file's content, if the spec has it in memory, under whatever folder.

    As in MuJoCo the base name decides; of several, the one whose path ends alike.
    """
    held = {Path(path): content for path, content in spec.assets.items()}
    for path in (Path(name), Path(where, name)):
        if path in held:
            return held[path]
    path = _of_attached(name, list(held)) or _of_attached(PurePath(name).name, list(held))
    return held[path] if path else None


def _of_attached(name: str, files: Sequence[Path]) -> Path | None:
    """The one of `files` that an attached model refers to by `name`; None if there is none.

    Raises InputError if there are several.
    """
    parts = [part for part in PurePath(name).parts if part not in (".", "..")]
    found = [file for file in files if list(file.parts[-len(parts) :]) == parts]
    if len(found) > 1:
        raise InputError(
            f"attached models have several files {name} ({', '.join(map(str, found))}), and MuJoCo "
            "does not tell which is whose: rename one"
        )
    return found[0] if found else None


def _copy(source: Path, folder: Path, number: int, held: bytes | None) -> str:
    """Copy a file; returns the copy's name: the source's, unless that is taken.

    `held`: the content, if the source is in memory.
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
