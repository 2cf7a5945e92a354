"""The table [actions] of a tuning file."""

from functools import partial

import mujoco

from simtune.simulation import DirectActions, JointActions, MapActions, MocapActions, ScaledActions
from simtune.tasks.tuning_file.object_names import find_objects
from simtune.toml_reading import TomlTable

_MAPPINGS = ("direct", "scaled", "joints", "mocap")


def read_actions(table: TomlTable, model: mujoco.MjModel) -> MapActions:
    """A function that makes a model's mapping. Raises InputError if it does not fit `model`."""
    mapping = table.choice("mapping", _MAPPINGS, "direct")
    map_actions: MapActions
    if mapping == "direct":
        table.allow("mapping", "columns", "actuators")
        map_actions = partial(DirectActions, actuators=_actuators(table, model))
    elif mapping == "scaled":
        table.allow("mapping", "columns", "actuators", "range", "gain", "offset")
        if "offset" in table and "gain" not in table:
            raise table.error("offset needs gain: a control is offset + gain · action", "offset")
        map_actions = partial(
            ScaledActions,
            actuators=_actuators(table, model),
            action_range=table.array("range", None),
            gain=table.array("gain", None),
            offset=table.array("offset", 0.0),
        )
    elif mapping == "joints":
        table.allow("mapping", "columns", "actuators", "per_unit", "range")
        map_actions = partial(
            JointActions,
            actuators=_actuators(table, model),
            per_unit=table.array("per_unit", 1.0),
            action_range=table.array("range", None),
        )
    else:
        table.allow("mapping", "columns", "body", "axes", "metres_per_unit", "range", "workspace_m")
        map_actions = partial(
            MocapActions,
            body=table.text("body"),
            axes=table.text("axes", "xyz"),
            metres_per_unit=table.number("metres_per_unit", 1.0, above=0),
            action_range=table.array("range", None),
            workspace_m=table.array("workspace_m", None),
        )
    with table.at():
        map_actions(model)
    return map_actions


def read_columns(table: TomlTable, map_actions: MapActions, model: mujoco.MjModel) -> tuple | None:
    """Names of the recordings' action columns, in the model's order; None: all columns."""
    columns = table.names("columns", None)
    if columns is None:
        return None
    if len(columns) != (count := len(map_actions(model).names)):
        raise table.error(
            f"expected {count} columns, one for each action; got {len(columns)}", "columns"
        )
    return columns


def _actuators(table: TomlTable, model: mujoco.MjModel) -> tuple[str, ...] | None:
    """The named actuators, in the given order; None: all."""
    if "actuators" not in table:
        return None
    with table.at("actuators"):
        return find_objects(model, "actuator", table.names("actuators"))
