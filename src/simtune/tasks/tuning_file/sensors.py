"""The tables [[sensors]] of a tuning file: what is measured beside pictures."""

import mujoco
import numpy as np

from simtune.errors import UnknownName
from simtune.observation import JointSensor
from simtune.simulation.actions import HINGE_OR_SLIDE
from simtune.tasks.tuning_file.toml_table import TomlTable

_KEYS = ("name", "columns", "joints", "quantity", "unit", "noise", "offset", "latency_s")
_HINGE = mujoco.mjtJoint.mjJNT_HINGE.value
_LONGEST_LATENCY_S = 1.0
# What a recorded number has to be divided by
_UNITS = {
    "rad": 1.0,
    "deg": 180 / np.pi,
    "m": 1.0,
    "mm": 1000.0,
}
_TURNS = ("rad", "deg")


def read_sensors(file: TomlTable, model: mujoco.MjModel) -> tuple[JointSensor, ...]:
    """All of them. Raises InputError."""
    sensors: list[JointSensor] = []
    for entry in file.tables("sensors"):
        sensor = _read(entry, model)
        if sensor.name in [other.name for other in sensors]:
            raise entry.error(f"there are two sensors {sensor.name!r}", "name")
        sensors.append(sensor)
    return tuple(sensors)


def _read(entry: TomlTable, model: mujoco.MjModel) -> JointSensor:
    entry.allow(*_KEYS)
    names = entry.names("joints")
    ids = np.array([_joint(entry, model, name) for name in names])
    columns = entry.names("columns", names)
    if len(columns) not in (1, len(names)):
        count = f"{len(names)} columns, one for each joint, or a single one that holds them all"
        raise entry.error(f"expected {count}; got {len(columns)}", "columns")
    is_hinge = model.jnt_type[ids] == _HINGE
    usual = "rad" if is_hinge.all() else "m"
    unit = entry.choice("unit", (*_UNITS, "percent"), usual)
    if unit != "percent" and (is_hinge != (unit in _TURNS)).any():
        odd = names[int((is_hinge != (unit in _TURNS)).argmax())]
        raise entry.error(f"{unit} is no unit of {odd}; give slides a sensor of their own", "unit")
    quantity = entry.choice("quantity", ("position", "velocity"), "position")
    if quantity == "velocity" and unit == "percent":
        raise entry.error("percent are of a joint's range: no unit of a velocity", "unit")
    factor, shift = _percent(entry, model, ids) if unit == "percent" else (_UNITS[unit], 0.0)
    per_unit = np.broadcast_to(factor, len(names)).astype(float)
    noise, offset = entry.number("noise", None, above=0), entry.number("offset", None)
    latency_s = entry.number("latency_s", 0.0)
    if not 0 <= latency_s <= _LONGEST_LATENCY_S:
        bound = f"lie in [0, {_LONGEST_LATENCY_S:g}] s"
        raise entry.error(f"latency_s must {bound}, got {latency_s:g}", "latency_s")
    is_velocity = quantity == "velocity"
    addresses = model.jnt_dofadr if is_velocity else model.jnt_qposadr
    return JointSensor(
        name=entry.text("name"),
        columns=columns,
        joints=names,
        places=addresses[ids].copy(),
        is_velocity=is_velocity,
        unit=("rad" if is_hinge.all() else "m") + "/s" * is_velocity,
        factor=per_unit,
        shift=np.broadcast_to(shift, len(names)).astype(float),
        noise=None if noise is None else noise / float(per_unit.mean()),
        offset=None if offset is None else offset / float(per_unit.mean()),
        latency_s=latency_s,
    )


def _joint(entry: TomlTable, model: mujoco.MjModel, name: str) -> int:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if index < 0:
        known = [model.joint(i).name for i in range(model.njnt)]
        raise entry.error(UnknownName("joint", name, "the model", known), "joints")
    if model.jnt_type[index] not in HINGE_OR_SLIDE:
        raise entry.error(f"{name} is neither hinge nor slide: no one number measures it", "joints")
    return index


def _percent(
    entry: TomlTable, model: mujoco.MjModel, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What a joint's position is multiplied by, and what is added: 0 to 100 over its range."""
    low, high = model.jnt_range[ids].T
    if not np.all(model.jnt_limited[ids]):
        name = model.joint(int(ids[np.argmin(model.jnt_limited[ids])])).name
        raise entry.error(f"{name} has no range in the model for percent to be of", "unit")
    factor = 100 / (high - low)
    return factor, -low * factor
