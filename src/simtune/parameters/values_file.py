"""Values of parameters in a JSON file."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from simtune.errors import InputError
from simtune.parameters.space import ParameterSpace


def read_parameters(path: Path | None, space: ParameterSpace) -> np.ndarray:
    """(N,) parameters from a JSON object of names and values; missing ones are nominal.

    Also accepts a run's result.json, or parameters.json of an export. Raises InputError.
    """
    if path is None:
        return space.nominal.copy()
    try:
        values: Any = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path} is not JSON: {error}") from error
    if not isinstance(values, dict):
        raise InputError(f"{path} must hold one JSON object of names and values")
    found = values.get("parameters")
    if isinstance(found, dict):
        means = (e.get("mean") if isinstance(e, dict) else e for e in found.values())
        values = dict(zip(found, means, strict=True))
    try:
        return space.from_dict(values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
