"""Controllers within a robot, to which recorded actions go: robosuite names them in its files."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_KEYS = "env_args", "env_info"  # attributes of /data: of robomimic, of robosuite's own demos
_ENDINGS = ".hdf5", ".h5"
_ACTIONS = {
    "OSC_POSE": "displacements and turns of an end effector",
    "OSC_POSITION": "displacements of an end effector",
    "IK_POSE": "displacements and turns of an end effector",
    "JOINT_POSITION": "displacements of joints, scaled",
    "JOINT_VELOCITY": "speeds of joints, scaled",
    "JOINT_TORQUE": "torques, scaled, to which the robot adds what holds its weight",
}
_LOG = "log joint torques (sim.data.ctrl) or joint targets at every step as the actions"
_MOCAP = ", or let the displacements move a mocap body"


def named_in(path: Path) -> str | None:
    """What a robomimic or robosuite file says of its actions, as part of a sentence.

    None if it is no HDF5, or names no known controller of a part that `_ACTIONS` has.
    """
    if path.suffix.lower() not in _ENDINGS:
        return None
    for key, text in _attributes(path).items():
        if found := _controllers(text):
            names = " and ".join(found)
            are = " and ".join(dict.fromkeys(_ACTIONS[name] for name in found))
            instead = _LOG + _MOCAP * ("end effector" in are)
            return (
                f"its {key} names the controller {names}: such actions are {are}, for a controller "
                f"within the robot, not for actuators; {instead} (docs/recordings.md, robosuite)"
            )
    return None


def _attributes(path: Path) -> dict[str, Any]:
    """The attributes of /data that may name controllers; none if the file is not readable."""
    try:
        import h5py

        with h5py.File(path, "r") as file:
            its = file["data"].attrs
            return {key: its[key] for key in _KEYS if key in its}
    except (ImportError, OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _controllers(text: Any) -> list[str]:
    """Known controllers in the JSON of one attribute, each once."""
    try:
        facts = json.loads(text)
        configs = facts.get("env_kwargs", facts).get("controller_configs")
        return list(dict.fromkeys(_types(configs)))
    except (ValueError, TypeError, AttributeError, RecursionError):
        return []


def _types(configs: Any) -> Iterator[str]:
    """Known ones: of a robot, of several, or of the parts of each (robosuite 1.5)."""
    if isinstance(configs, dict):
        if configs.get("type") in _ACTIONS:
            yield configs["type"]
        configs = list(configs.values())
    if isinstance(configs, list):
        for inner in configs:
            yield from _types(inner)
