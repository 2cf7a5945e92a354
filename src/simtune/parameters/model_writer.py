"""Write parameters into MuJoCo models, always from the nominal model."""

from collections.abc import Iterator

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch

from simtune.errors import UnknownName
from simtune.parameters.field_index import field_index, refuse_overlaps, refuse_unprepared
from simtune.parameters.fields import field_of
from simtune.parameters.parameter import Parameter
from simtune.parameters.space import ParameterSpace

# Objects of exactly this rgba are drawn in their material's colour instead of their own
DEFAULT_GREY = (0.5, 0.5, 0.5, 1.0)


class ModelWriter:
    """Writes vectors of a ParameterSpace into models compiled like `model`.

    Every write starts from the nominal values, so writing twice equals writing once. The inertia
    scales with the mass, and a servo's bias with its gain, unless they are parameters themselves;
    directions get a length of 1, and derived constants are updated (mj_setConst). Rotations of one
    object about several axes are applied in the order x, y, z, each about the axis as the previous
    rotation left it.
    Raises UnknownName for a field or an object that the model lacks. Raises InputError for a
    component that the field lacks, a number that two parameters would write, or a parameter that
    the model was not prepared for (`simulation.prepare`).
    """

    def __init__(self, space: ParameterSpace, model: mujoco.MjModel):
        self.space = space
        self._nominal = {f: _nominal(model, f) for f in self.written}
        self._indices = [field_index(model, parameter, self._nominal) for parameter in space]
        refuse_overlaps(space, self._indices, self._nominal)
        refuse_unprepared(model, space, self._indices)
        self._order = sorted(range(len(space)), key=lambda i: _rank(space.parameters[i]))
        self._painted: dict[str, np.ndarray] = {}  # {rgba field: rows that parameters write}
        for field in (f for f in self._nominal if field_of(f).material_ids):
            indices = zip(space, self._indices, strict=True)
            rows = np.unique(np.concatenate([at[0] for p, at in indices if p.field == field]))
            self._painted[field] = rows
            start_from_material(self._nominal[field], rows, model, field)
        self._set_const = any(
            field_of(f).is_option or f in mujoco.MjModel._setconst_inputs for f in self._nominal
        )

    @property
    def written(self) -> dict[str, list[str]]:
        """{field: names of the objects it is written for}, including fields carried along."""
        written: dict[str, dict[str, None]] = {}
        for p in self.space:
            for field in filter(None, (p.field, p.field_info.carries)):
                written.setdefault(field, {}).update(dict.fromkeys(p.objects))
        return {field: list(names) for field, names in written.items()}

    def write(self, model: mujoco.MjModel, parameters: np.ndarray) -> None:
        """Write one vector (N,) into a model."""
        parameters = np.asarray(parameters)
        if parameters.shape != (len(self.space),):
            raise ValueError(f"parameters must be ({len(self.space)},), got {parameters.shape}")
        for field, values in self._values(parameters[None]):
            field_of(field).write(model, values[0])
        if self._set_const:
            mujoco.mj_setConst(model, mujoco.MjData(model))

    def write_batch(self, batch: Batch, parameters: np.ndarray) -> None:
        """Write (nsim, N) parameters, one vector for each simulation of the batch."""
        parameters = np.asarray(parameters)
        expected = (batch.nsim, len(self.space))
        if parameters.shape != expected:
            raise ValueError(f"parameters must be {expected}, got {parameters.shape}")
        for field, values in self._values(parameters):
            batch.expand(field)[...] = values
        if self._set_const:
            batch.set_const()

    def _values(self, parameters: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
        n = len(parameters)
        fields = {f: np.repeat(v[None], n, axis=0) for f, v in self._nominal.items()}
        for i in self._order:
            parameter = self.space.parameters[i]
            _write_one(fields, parameter, self._indices[i], self._nominal, parameters[:, i])
        for field, rows in self._painted.items():
            grey = (fields[field][:, rows] == DEFAULT_GREY).all(-1)  # (n, rows)
            nudged = np.nextafter(np.float32(DEFAULT_GREY[0]), np.float32(1))
            fields[field][:, rows, 0] = np.where(grey, nudged, fields[field][:, rows, 0])
        for field, values in fields.items():
            if field_of(field).is_direction:
                length = np.linalg.norm(values, axis=-1, keepdims=True)
                values /= np.maximum(length, np.finfo(values.dtype).tiny)
        yield from fields.items()


def _rank(parameter: Parameter) -> tuple[bool, int]:
    """Sort key for the order of writing.

    Masses and gains come first, so that an inertia or bias that is itself a parameter overwrites
    the scaled one. Rotations about x come before those about y and z.
    """
    return not parameter.field_info.carries, parameter.component or 0


def _write_one(fields, parameter: Parameter, index: tuple, nominal, values: np.ndarray) -> None:
    """Put one parameter's values (n,) into the arrays (n, ...) of its field."""
    info = parameter.field_info
    if info.is_rotation:
        rows, axis = index
        fields[parameter.field][:, rows] = _rotated(fields[parameter.field][:, rows], axis, values)
        return
    before = nominal[parameter.field][index]  # (objects, ...)
    shaped = values.reshape(-1, *[1] * before.ndim)
    if parameter.is_factor:  # a sum of one object is its own value
        shaped = before * (shaped / parameter.nominal if parameter.is_sum else shaped)
    elif info.form == "range":
        shaped = shaped * [-1, 1]
    elif info.form == "play":
        shaped = shaped * [-0.5, 0.5]
    elif info.form == "negative":
        shaped = -shaped
    elif info.form == "shift":
        shaped = before + shaped
    after = np.broadcast_to(shaped, (len(values), *before.shape))
    fields[parameter.field][(slice(None), *index)] = after
    if info.form == "shift":  # the spring's rest position stays the same, seen from the body
        springs = nominal[info.carries][index[0]]
        fields[info.carries][:, index[0]] = springs + (after - before)
    elif info.carries:
        _carry(fields, parameter, index[0], nominal, after / np.where(before > 0, before, 1))


def _carry(fields, parameter: Parameter, rows: np.ndarray, nominal, ratio: np.ndarray) -> None:
    """Scale the inertias of masses, or the biases of gains, that are `ratio` times nominal.

    `ratio`: (n, objects).
    """
    if parameter.field_info.carries == "body_inertia":
        inertia = nominal["body_inertia"][rows]  # (objects, 3)
        fields["body_inertia"][:, rows] = inertia * ratio[..., None]
    elif parameter.component is not None:
        _carry_muscles(fields, rows, parameter.component, nominal)
    if parameter.field_info.carries == "actuator_biasprm" and parameter.component == 0:
        # A servo's force is gain · control + bias0 − kp · position, or gain · control − gain ·
        # velocity. All must be scaled, else its target moves.
        gain, bias = nominal["actuator_gainprm"][rows, 0], nominal["actuator_biasprm"][rows]
        of_position, of_velocity = bias[:, 1] < 0, bias[:, 2] == -gain
        for i in np.flatnonzero((of_position | of_velocity) & (gain > 0)):
            for column in (0, 1) if of_position[i] else (2,):
                fields["actuator_biasprm"][:, rows[i], column] = bias[i, column] * ratio[:, i]


def _carry_muscles(fields, rows: np.ndarray, component: int, nominal) -> None:
    """Give the passive force of muscles, which is the bias, the numbers of the active one."""
    gain, bias = (nominal[f"actuator_{what}prm"][rows] for what in ("gain", "bias"))
    muscles = rows[(gain == bias).all(1) & gain[:, 4:].any(1)]  # of the others none has so many
    active = fields["actuator_gainprm"][:, muscles, component]
    fields["actuator_biasprm"][:, muscles, component] = active


def _rotated(quats: np.ndarray, axis: int, angles: np.ndarray) -> np.ndarray:
    """(n, objects, 4) orientations w, x, y, z rotated by (n,) rad about the objects' own axis."""
    cos, sin = np.cos(angles / 2)[:, None, None], np.sin(angles / 2)[:, None, None]
    w, rest = quats[..., :1], quats[..., 1:]
    unit = np.eye(3)[axis]
    real = w * cos - rest[..., axis, None] * sin
    imaginary = rest * cos + (w * unit + np.cross(rest, unit)) * sin
    return np.concatenate([real, imaginary], axis=-1)


def _nominal(model: mujoco.MjModel, field: str) -> np.ndarray:
    """A copy of an MjModel field or an option. Raises UnknownName."""
    if field not in MODEL_FIELDS:
        raise UnknownName("field", field, "MjModel", sorted(MODEL_FIELDS))
    return np.array(field_of(field).read(model))


def start_from_material(
    rgba: np.ndarray, rows: np.ndarray, model: mujoco.MjModel, field: str
) -> None:
    """Set `rows` of an rgba field to the colour they are drawn in, which may be a material's."""
    if not (material_ids := field_of(field).material_ids):
        return
    for row in rows:
        material = getattr(model, material_ids)[row]
        if material >= 0 and (rgba[row] == DEFAULT_GREY).all():
            rgba[row] = model.mat_rgba[material]
