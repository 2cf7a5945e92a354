"""Controllers within a robot, to which recorded actions go: robosuite names them in its files."""

import re
from pathlib import Path
from typing import Any

_KEYS = "env_args", "env_info"  # attributes of /data, JSON: of robomimic, of robosuite's own demos
_ENDINGS = ".hdf5", ".h5"
# Such as OSC_POSE; a whole robot's BASIC and a gripper's GRIP are none.
_CONTROLLER = re.compile(r'"type": *"((?:OSC|IK|JOINT)_\w+)"')


def named_in(path: Path) -> str | None:
    """What a robomimic or robosuite file says of its actions, as part of a sentence.

    None if it is no HDF5, or names no controller.
    """
    if path.suffix.lower() not in _ENDINGS:
        return None
    for key, text in _attributes(path).items():
        if names := " and ".join(dict.fromkeys(_CONTROLLER.findall(str(text)))):
            return (
                f"its {key} names the controller {names}: such actions are for a controller within "
                "the robot, not for actuators; log joint torques (sim.data.ctrl) or joint targets "
                "at every step as the actions (docs/recordings.md, robosuite)"
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
