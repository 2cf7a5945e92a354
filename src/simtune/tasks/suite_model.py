"""The control suite's model files, read without importing dm_control (which loads OpenGL)."""

from importlib.util import find_spec
from pathlib import Path

import mujoco


def load_suite_spec(filename: str) -> mujoco.MjSpec:
    """The suite's model `filename` with the assets it includes, e.g. "walker.xml"."""
    package = find_spec("dm_control")  # finds a top-level package without importing it
    if package is None or not package.submodule_search_locations:
        raise ModuleNotFoundError("dm_control is not installed; the built-in tasks need its models")
    return mujoco.MjSpec.from_file(
        str(Path(package.submodule_search_locations[0]) / "suite" / filename)
    )
