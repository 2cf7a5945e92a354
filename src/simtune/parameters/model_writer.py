"""Write parameters into MuJoCo models, always from the nominal model."""

from collections.abc import Iterator

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch

from simtune.errors import InputError, UnknownName
from simtune.parameters.parameter import Parameter
from simtune.parameters.space import ParameterSpace

# What an object of a field's first word is called in MuJoCo.
_OBJECT_TYPES = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "jnt": mujoco.mjtObj.mjOBJ_JOINT,
    "dof": mujoco.mjtObj.mjOBJ_JOINT,
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "cam": mujoco.mjtObj.mjOBJ_CAMERA,
    "light": mujoco.mjtObj.mjOBJ_LIGHT,
    "mat": mujoco.mjtObj.mjOBJ_MATERIAL,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "eq": mujoco.mjtObj.mjOBJ_EQUALITY,
}
_DEFAULT_GREY = 0.5  # a geom of exactly this grey takes its material's colour instead


class ModelWriter:
    """Writes vectors of a ParameterSpace into models compiled like `model`.

    Every write starts from the nominal values, so writing twice equals writing once. Mass
    carries the inertia along, and derived constants follow (mj_setConst).
    Raises UnknownName for a field or an object that the model lacks.
    """

    def __init__(self, space: ParameterSpace, model: mujoco.MjModel):
        self.space = space
        self._nominal = {f: _field(model, f).copy() for f in _fields_to_write(space)}
        self._rows = [_rows(model, parameter) for parameter in space]
        self._set_const = any(
            f.startswith("opt.") or f in mujoco.MjModel._setconst_inputs for f in self._nominal
        )

    def write(self, model: mujoco.MjModel, parameters: np.ndarray) -> None:
        """Write one vector (N,) into a model."""
        for field, values in self._values(np.asarray(parameters)[None]):
            _field(model, field)[...] = values[0]
        if self._set_const:
            mujoco.mj_setConst(model, mujoco.MjData(model))

    def write_batch(self, batch: Batch, parameters: np.ndarray) -> None:
        """Write (nsim, N): one vector for each simulation of the batch."""
        parameters = np.asarray(parameters)
        expected = (batch.nsim, len(self.space))
        if parameters.shape != expected:
            raise ValueError(f"parameters must be {expected}, got {parameters.shape}")
        for field, values in self._values(parameters):
            batch.expand(field)[...] = values
        if self._set_const:
            batch.set_const()

    def fields(self, parameters: np.ndarray) -> dict[str, np.ndarray]:
        """The written fields, {field: (n, ...)}, for (n, N): what a renderer needs of them."""
        return dict(self._values(np.asarray(parameters)))

    def _values(self, parameters: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
        n = len(parameters)
        fields = {f: np.repeat(v[None], n, axis=0) for f, v in self._nominal.items()}
        for i, (parameter, rows) in enumerate(zip(self.space, self._rows, strict=True)):
            _write_one(fields, parameter, rows, self._nominal, parameters[:, i])
        if "geom_rgba" in fields:
            rgba = fields["geom_rgba"]
            grey = (rgba == np.float32([_DEFAULT_GREY] * 3 + [1])).all(-1)
            rgba[grey, 0] = np.nextafter(np.float32(_DEFAULT_GREY), np.float32(1))
        yield from fields.items()


def _write_one(fields, parameter: Parameter, rows, nominal, values: np.ndarray) -> None:
    """Put one parameter's values (n,) into the arrays (n, ...) of its field."""
    if rows is None:  # an option: a scalar or a vector without objects
        target = fields[parameter.field]
        if parameter.component is None:
            target[...] = values.reshape(-1, *[1] * (target.ndim - 1))
        else:
            target[:, parameter.component] = values
        return
    at = (rows,) if parameter.component is None else (rows, parameter.component)
    if nominal[parameter.field].ndim > 1 and parameter.field in _RGBA and parameter.component is None:
        at = (rows, slice(0, 3))  # a grey: alpha stays
    before = nominal[parameter.field][at]  # (objects, ...)
    shaped = values.reshape(-1, *[1] * before.ndim)
    after = before * shaped if parameter.is_factor else np.broadcast_to(shaped, (len(values), *before.shape))
    fields[parameter.field][(slice(None), *at)] = after
    if parameter.field == "body_mass":
        ratio = after / np.where(before > 0, before, 1)
        fields["body_inertia"][:, rows] = nominal["body_inertia"][rows] * ratio[..., None]


_RGBA = ("geom_rgba", "mat_rgba", "site_rgba")


def _fields_to_write(space: ParameterSpace) -> list[str]:
    fields = dict.fromkeys(parameter.field for parameter in space)
    if "body_mass" in fields:
        fields["body_inertia"] = None
    return list(fields)


def _field(model: mujoco.MjModel, field: str) -> np.ndarray:
    """The live array of an MjModel field, or a view of an option."""
    if field not in MODEL_FIELDS:
        raise UnknownName("field", field, "MjModel", sorted(MODEL_FIELDS))
    if field.startswith("opt."):
        return np.atleast_1d(getattr(model.opt, field[4:]))
    return getattr(model, field)


def _rows(model: mujoco.MjModel, parameter: Parameter) -> np.ndarray | None:
    """Rows of the field that the parameter's objects own; None for an option."""
    if parameter.field.startswith("opt."):
        return None
    word = parameter.field.split("_")[0]
    if word not in _OBJECT_TYPES or not parameter.objects:
        raise InputError(f"{parameter.name}: {parameter.field} needs the names of its objects")
    kind = _OBJECT_TYPES[word]
    rows: list[int] = []
    for name in parameter.objects:
        index = mujoco.mj_name2id(model, kind, name)
        if index < 0:
            raise UnknownName(kind.name[6:].lower(), name, "the model", _names(model, kind))
        if word != "dof":
            rows.append(index)
        else:
            rows.extend(d for d in range(model.nv) if model.dof_jntid[d] == index)
    return np.array(rows)


def _names(model: mujoco.MjModel, kind: mujoco.mjtObj) -> list[str]:
    names, index = [], 0
    while (name := mujoco.mj_id2name(model, kind, index)) is not None:
        names.append(name)
        index += 1
    return names
