"""The tables [[sensors]] of a tuning file: measurements beside pictures."""

from typing import get_args

import mujoco
import numpy as np

from simtune.observation import JointSensor, Quantity
from simtune.parameters.backlash_joints import play_of
from simtune.parameters.joint_types import HINGE, HINGE_OR_SLIDE
from simtune.simulation.driven_joints import driven_joints
from simtune.tasks.tuning_file.object_names import find_objects
from simtune.toml_reading import TomlTable
from simtune.units import PER_RAD_OR_M, TURNS

_KEYS = ("name", "columns", "joints", "quantity", "unit", "gain", "noise", "offset")
_KEYS += ("latency_s", "behind_backlash")
# Values at the ends of a joint's range; LeRobot uses both units
_OF_RANGE = {"percent": (0.0, 100.0), "-100..100": (-100.0, 100.0)}
_COLUMN_SUFFIX: dict[Quantity, str] = {"position": "", "velocity": ".vel", "torque": ".torque"}
_KINDS = ("cameras", "joints")


def read_sensors(file: TomlTable, model: mujoco.MjModel) -> tuple[JointSensor, ...]:
    """Read all sensors. Raises InputError."""
    sensors: list[JointSensor] = []
    for entry in file.tables("sensors"):
        sensor = _read(entry, model)
        if "," in sensor.name or sensor.name != sensor.name.strip():
            raise entry.error(
                f"--observe could not ask for {sensor.name!r}: leave commas out, and blanks around",
                "name",
            )
        if sensor.name in _KINDS:
            raise entry.error(
                f"{sensor.name!r} is what --observe calls all {sensor.name}: choose another name",
                "name",
            )
        if sensor.name in [other.name for other in sensors]:
            raise entry.error(f"there are two sensors {sensor.name!r}", "name")
        sensors.append(sensor)
    return tuple(sensors)


def _read(entry: TomlTable, model: mujoco.MjModel) -> JointSensor:
    entry.allow(*_KEYS)
    with entry.at("joints"):
        names = find_objects(model, "joint", entry.names("joints"))
    if doubled := [name for i, name in enumerate(names) if name in names[:i]]:
        raise entry.error(f"joints has {doubled[0]} twice: name it once", "joints")
    ids = np.array([_joint(entry, model, name) for name in names])
    quantity = entry.choice("quantity", get_args(Quantity), "position")
    usual_columns = tuple(f"{name}{_COLUMN_SUFFIX[quantity]}" for name in names)
    columns = entry.names("columns", usual_columns)
    if len(columns) not in (1, len(names)):
        count = f"{len(names)} columns, one for each joint, or a single one that holds them all"
        raise entry.error(f"expected {count}; got {len(columns)}", "columns")
    factor, shift = _recorded_per_unit(entry, model, ids, quantity)
    noise, offset = entry.number("noise", None, above=0), entry.number("offset", None)
    if quantity == "torque":
        _check_torque(entry, model, ids)
    addresses = model.jnt_qposadr if quantity == "position" else model.jnt_dofadr
    geared = plays = np.zeros(0, int)
    if entry.flag("behind_backlash", default=False):
        geared, plays = _plays(entry, model, ids)
    return JointSensor(
        name=entry.text("name"),
        columns=columns,
        joints=names,
        places=addresses[ids].copy(),
        geared=geared,
        play_places=addresses[plays].copy(),
        quantity=quantity,
        unit=_unit(model, ids, quantity),
        factor=factor,
        shift=shift,
        noise=None if noise is None else noise / np.abs(factor),
        offset=None if offset is None else offset / factor,
        latency_s=entry.number("latency_s", 0.0, least=0, most=1),
        endless=_endless(model, ids) if quantity == "position" else None,
    )


def _endless(model: mujoco.MjModel, ids: np.ndarray) -> np.ndarray | None:
    """(D,) bool: hinges without limits; None: all have some."""
    endless = (model.jnt_type[ids] == HINGE) & ~np.asarray(model.jnt_limited[ids], bool)
    return endless if endless.any() else None


def _plays(
    entry: TomlTable, model: mujoco.MjModel, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(G,) which of the joints have backlash, and the (G,) ids of the joints of it."""
    plays = np.array([play_of(model, joint) for joint in ids])
    (geared,) = np.nonzero(plays >= 0)
    if not len(geared):
        raise entry.error("none of the joints has one: declare [[backlash]]", "behind_backlash")
    return geared, plays[geared]


def _check_torque(entry: TomlTable, model: mujoco.MjModel, ids: np.ndarray) -> None:
    if "noise" not in entry:
        raise entry.error("give the noise of a torque: nothing is usual", "quantity")
    if entry.flag("behind_backlash", default=False):
        raise entry.error("motors exert torques before the backlash", "behind_backlash")
    driven = driven_joints(model)
    if idle := [joint for joint in ids.tolist() if joint not in driven]:
        name = model.joint(idle[0]).name
        raise entry.error(f"nothing drives {name}: it has no motor's torque", "joints")


def _own_unit(model: mujoco.MjModel, ids: np.ndarray) -> str:
    return "rad" if (model.jnt_type[ids] == HINGE).all() else "m"


def _unit(model: mujoco.MjModel, ids: np.ndarray, quantity: Quantity) -> str:
    own = _own_unit(model, ids)
    if quantity == "torque":
        return {"rad": "N·m", "m": "N"}[own]
    return own + "/s" * (quantity == "velocity")


def _recorded_per_unit(
    entry: TomlTable, model: mujoco.MjModel, ids: np.ndarray, quantity: Quantity
) -> tuple[np.ndarray, np.ndarray]:
    """(D,) factor and (D,) shift that turn the joints' own unit into recorded numbers."""
    if "gain" in entry:
        _check_kinds(entry, model, ids)
        return 1 / _gains(entry, len(ids)), np.zeros(len(ids))
    if quantity == "torque":
        _check_kinds(entry, model, ids)
        if "unit" in entry:
            raise entry.error("torques are in N·m, of slides in N: else give a gain", "unit")
        return np.ones(len(ids)), np.zeros(len(ids))
    unit = entry.choice("unit", (*PER_RAD_OR_M, *_OF_RANGE), _own_unit(model, ids))
    if unit in _OF_RANGE:
        if quantity == "velocity":
            raise entry.error(f"{unit} is of a joint's range: no unit of a velocity", "unit")
        return _of_range(entry, model, ids, unit)
    is_odd = (model.jnt_type[ids] == HINGE) != (unit in TURNS)
    if is_odd.any():
        odd = model.joint(int(ids[is_odd.argmax()])).name
        raise entry.error(f"{unit} is no unit of {odd}; give slides a sensor of their own", "unit")
    return np.full(len(ids), PER_RAD_OR_M[unit]), np.zeros(len(ids))


def _gains(entry: TomlTable, num: int) -> np.ndarray:
    """(D,) rad or m of one recorded unit, from a number or one for each joint."""
    if "unit" in entry:
        raise entry.error("give unit or gain, not both", "gain")
    try:
        gains = np.asarray(entry.array("gain"), float)
    except ValueError:  # a list of lists of different lengths
        gains = np.empty((0, 0))
    if gains.shape not in ((), (num,)) or not np.isfinite(gains).all() or not gains.all():
        raise entry.error(
            f"gain must be a number, or {num} of them, one for each joint, and none 0", "gain"
        )
    return np.broadcast_to(gains, num)


def _check_kinds(entry: TomlTable, model: mujoco.MjModel, ids: np.ndarray) -> None:
    if len(set(model.jnt_type[ids].tolist())) > 1:
        raise entry.error("give hinges and slides sensors of their own", "joints")


def _joint(entry: TomlTable, model: mujoco.MjModel, name: str) -> int:
    index = model.joint(name).id
    if model.jnt_type[index] not in HINGE_OR_SLIDE:
        raise entry.error(f"{name} is neither hinge nor slide: no one number measures it", "joints")
    return index


def _of_range(
    entry: TomlTable, model: mujoco.MjModel, ids: np.ndarray, unit: str
) -> tuple[np.ndarray, np.ndarray]:
    """Factor and shift, as in `_recorded_per_unit`, for a unit that is relative to the range."""
    _check_kinds(entry, model, ids)
    low, high = model.jnt_range[ids].T
    if not np.all(model.jnt_limited[ids]):
        name = model.joint(int(ids[np.argmin(model.jnt_limited[ids])])).name
        raise entry.error(f"{name} has no range in the model for {unit} to be of", "unit")
    first, last = _OF_RANGE[unit]
    factor = (last - first) / (high - low)
    return factor, first - low * factor
