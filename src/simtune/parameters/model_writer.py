"""Write parameters into MuJoCo models, always from the nominal model."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch

from simtune.errors import InputError, UnknownName
from simtune.parameters.parameter import Parameter
from simtune.parameters.space import ParameterSpace

# What an object of a field's first word is called in MuJoCo, and where their number is.
_OBJECT_TYPES = {
    "body": (mujoco.mjtObj.mjOBJ_BODY, "nbody"),
    "geom": (mujoco.mjtObj.mjOBJ_GEOM, "ngeom"),
    "jnt": (mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "dof": (mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "site": (mujoco.mjtObj.mjOBJ_SITE, "nsite"),
    "cam": (mujoco.mjtObj.mjOBJ_CAMERA, "ncam"),
    "light": (mujoco.mjtObj.mjOBJ_LIGHT, "nlight"),
    "mat": (mujoco.mjtObj.mjOBJ_MATERIAL, "nmat"),
    "actuator": (mujoco.mjtObj.mjOBJ_ACTUATOR, "nu"),
    "tendon": (mujoco.mjtObj.mjOBJ_TENDON, "ntendon"),
    "eq": (mujoco.mjtObj.mjOBJ_EQUALITY, "neq"),
}
# Objects of exactly this rgba are drawn in their material's colour instead of their own.
_DEFAULT_GREY = np.array([0.5, 0.5, 0.5, 1], np.float32)
_MATERIAL_OF = {
    "geom_rgba": "geom_matid",
    "site_rgba": "site_matid",
    "tendon_rgba": "tendon_matid",
}


class ModelWriter:
    """Writes vectors of a ParameterSpace into models compiled like `model`.

    Every write starts from the nominal values, so writing twice equals writing once. Mass
    carries the inertia along (an inertia that is a parameter itself is taken from there), and
    derived constants follow (mj_setConst).
    Raises UnknownName for a field or an object that the model lacks, and InputError for a
    component that the field lacks or a number that two parameters would write.
    """

    def __init__(self, space: ParameterSpace, model: mujoco.MjModel):
        self.space = space
        self._nominal = {f: np.array(_read(model, f)) for f in _fields_to_write(space)}
        self._places = [_place(model, parameter, self._nominal) for parameter in space]
        _refuse_overlaps(space, self._places, self._nominal)
        self._painted: dict[str, np.ndarray] = {}  # {rgba field: rows that parameters write}
        for field in _MATERIAL_OF.keys() & self._nominal.keys():
            places = zip(space, self._places, strict=True)
            rows = np.unique(np.concatenate([at[0] for p, at in places if p.field == field]))
            self._painted[field] = rows
            _start_from_material(self._nominal[field], rows, model, _MATERIAL_OF[field])
        self._set_const = any(
            f.startswith("opt.") or f in mujoco.MjModel._setconst_inputs for f in self._nominal
        )

    def write(self, model: mujoco.MjModel, parameters: np.ndarray) -> None:
        """Write one vector (N,) into a model."""
        parameters = np.asarray(parameters)
        if parameters.shape != (len(self.space),):
            raise ValueError(f"parameters must be ({len(self.space)},), got {parameters.shape}")
        for field, values in self._values(parameters[None]):
            _write(model, field, values[0])
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
        # masses first, so that an inertia that is a parameter itself is written over theirs
        order = sorted(
            range(len(self.space)), key=lambda i: self.space.parameters[i].field != "body_mass"
        )
        for i in order:
            parameter = self.space.parameters[i]
            _write_one(fields, parameter, self._places[i], self._nominal, parameters[:, i])
        for field, rows in self._painted.items():
            grey = (fields[field][:, rows] == _DEFAULT_GREY).all(-1)  # (n, rows)
            nudged = np.nextafter(_DEFAULT_GREY[0], np.float32(1))
            fields[field][:, rows, 0] = np.where(grey, nudged, fields[field][:, rows, 0])
        yield from fields.items()


def _write_one(fields, parameter: Parameter, place: tuple, nominal, values: np.ndarray) -> None:
    """Put one parameter's values (n,) into the arrays (n, ...) of its field."""
    before = nominal[parameter.field][place]  # (objects, ...)
    shaped = values.reshape(-1, *[1] * before.ndim)
    after = (
        before * shaped
        if parameter.is_factor
        else np.broadcast_to(shaped, (len(values), *before.shape))
    )
    fields[parameter.field][(slice(None), *place)] = after
    if parameter.field == "body_mass":
        ratio = after / np.where(before > 0, before, 1)  # (n, objects)
        inertia = nominal["body_inertia"][place[0]]  # (objects, 3)
        fields["body_inertia"][:, place[0]] = inertia * ratio[..., None]


def _fields_to_write(space: ParameterSpace) -> list[str]:
    fields = dict.fromkeys(parameter.field for parameter in space)
    if "body_mass" in fields:
        fields["body_inertia"] = None
    return list(fields)


def _read(model: mujoco.MjModel, field: str) -> Any:
    """An MjModel field, or an option: an array or, as opt.timestep is, a number."""
    if field not in MODEL_FIELDS:
        raise UnknownName("field", field, "MjModel", sorted(MODEL_FIELDS))
    return getattr(model.opt, field[4:]) if field.startswith("opt.") else getattr(model, field)


def _write(model: mujoco.MjModel, field: str, value: np.ndarray) -> None:
    if value.ndim == 0:  # a number is no view into the model: it has to be set
        setattr(model.opt, field.removeprefix("opt."), value.item())
    else:
        _read(model, field)[...] = value


def _place(model: mujoco.MjModel, parameter: Parameter, nominal: dict[str, np.ndarray]) -> tuple:
    """Where in its field a parameter is: (rows,), (rows, component), or without rows."""
    name, field = parameter.name, parameter.field
    component: tuple = () if parameter.component is None else (parameter.component,)
    if field.startswith("opt."):
        if parameter.objects:
            raise InputError(f"{name}: {field} has no objects, got {', '.join(parameter.objects)}")
        place = component or (...,)
    else:
        if field.endswith("_rgba") and not component:
            component = (slice(0, 3),)  # a grey: alpha stays
        place = (_rows(model, parameter), *component)
    try:
        nominal[field][place]
    except IndexError:
        raise InputError(f"{name}: {field} has no component {parameter.component}") from None
    return place


def _rows(model: mujoco.MjModel, parameter: Parameter) -> np.ndarray:
    """Rows of the field that the parameter's objects own."""
    word = parameter.field.split("_")[0]
    if word not in _OBJECT_TYPES:
        raise InputError(
            f"{parameter.name}: {parameter.field} cannot be written; "
            f"fields of these can: {', '.join(_OBJECT_TYPES)}, opt"
        )
    if not parameter.objects:
        raise InputError(f"{parameter.name}: {parameter.field} needs the names of its objects")
    kind, count = _OBJECT_TYPES[word]
    rows: list[int] = []
    for name in parameter.objects:
        index = mujoco.mj_name2id(model, kind, name)
        if index < 0:
            names = (mujoco.mj_id2name(model, kind, i) for i in range(getattr(model, count)))
            known = [n for n in names if n]  # those without a name cannot be asked for
            raise UnknownName(kind.name[6:].lower(), name, "the model", known)
        if word != "dof":
            rows.append(index)
        else:
            rows.extend(d for d in range(model.nv) if model.dof_jntid[d] == index)
    return np.array(rows)


def _refuse_overlaps(space: ParameterSpace, places: list[tuple], nominal) -> None:
    """Two parameters that write the same number cannot both be found."""
    owner = {field: np.full(values.shape, -1) for field, values in nominal.items()}
    for i, (parameter, place) in enumerate(zip(space, places, strict=True)):
        others = owner[parameter.field][place]
        if (others >= 0).any():
            other = space.parameters[others.max()].name
            raise InputError(f"{other} and {parameter.name} write the same {parameter.field}")
        owner[parameter.field][place] = i


def _start_from_material(
    rgba: np.ndarray, rows: np.ndarray, model: mujoco.MjModel, field: str
) -> None:
    """Give `rows` of an rgba field the colour they are drawn in, which may be a material's."""
    for row in rows:
        material = getattr(model, field)[row]
        if material >= 0 and (rgba[row] == _DEFAULT_GREY).all():
            rgba[row] = model.mat_rgba[material]
