"""The truth of a run, drawn from its number: no world is chosen by hand."""

import zlib

import numpy as np

from simtune.parameters import Parameter, ParameterSpace

_FACTOR = 2.0  # of nominal, up or down
_FACTORS = {"rope_length": 1.25}  # the arm's reach allows no more
_COLOURS = (0.25, 1.0)
_LEVELS = {"lighting": (0.2, 0.6)}  # of the arm's scenes


def draw(task: str, space: ParameterSpace, seed: int) -> dict[str, float]:
    """Dynamics log-uniform within ×½ to ×2 of nominal, colours and light uniform."""
    rng = np.random.default_rng((zlib.crc32(task.encode()), seed))
    values = np.array([_value(p, rng.random()) for p in space])
    return space.to_dict(space.clip(values))


def _value(parameter: Parameter, share: float) -> float:
    """The parameter at `share` of the way from its lowest truth to its highest."""
    if parameter.is_appearance:
        low, high = _LEVELS.get(parameter.name, _COLOURS)
        return low + share * (high - low)
    return parameter.nominal * _FACTORS.get(parameter.name, _FACTOR) ** (2 * share - 1)
