"""Runs' estimates of the parameters that all of them tuned, along one scale each."""

from collections.abc import Sequence
from functools import reduce
from hashlib import sha256
from typing import Any, NamedTuple

import numpy as np

from simtune.columns import cut
from simtune.errors import InputError
from simtune.names import search_traits
from simtune.run.sources import SOURCES
from simtune.run_data import RunData

_MOST_NAMED = 5  # parameters


class Estimates(NamedTuple):
    """A run's estimates from result.json, in unit coordinates."""

    coordinates: dict[str, dict[str, Any]]  # by name: scale, low, high
    mean: np.ndarray  # (N,)
    std: np.ndarray  # (N,)

    def along(self, coordinates: dict[str, dict[str, Any]]) -> "Estimates":
        """Those named, in these coordinates of the same scales and perhaps other bounds."""
        rows = [list(self.coordinates).index(name) for name in coordinates]
        own = np.array([_ends(self.coordinates[name]) for name in coordinates])
        their = np.array([_ends(its) for its in coordinates.values()])
        width, wanted = np.diff(own)[:, 0], np.diff(their)[:, 0]
        mean = (own[:, 0] + self.mean[rows] * width - their[:, 0]) / wanted
        return Estimates(coordinates, mean, self.std[rows] * width / wanted)


def read_estimates(run: RunData) -> Estimates:
    """A run's estimates. Raises InputError if it has no intervals or is damaged."""
    if not run.is_tuned or not search_traits(run.result.get("search")).has_intervals:
        how = run.result.get("search") or f"--method {run.result.get('method')}"
        raise InputError(f"{run.path} is of {how}, which gives no intervals to compare")
    if not (stored := run.object("covariance")):
        raise InputError(
            f"{run.path} says nothing of covariance, since an earlier version wrote it: give its "
            "command once more"
        )
    try:
        coordinates = {its["name"]: its for its in stored["coordinates"]}
        mean, matrix = (np.array(stored[key], float) for key in ("mean", "matrix"))
        if matrix.shape != (len(coordinates), len(mean)) or not np.isfinite(matrix).all():
            raise ValueError("its covariance has no number for each pair of parameters")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{run.path / 'result.json'} is damaged: {error}") from None
    return Estimates(coordinates, mean, np.sqrt(np.diag(matrix)))


def in_common(
    runs: Sequence[RunData], estimates: Sequence[Estimates]
) -> tuple[list[Estimates], list[str]]:
    """Estimates of what all runs tuned on one scale, in the first's coordinates, and notes.

    The notes say what is left out, and what has other bounds. Raises InputError for runs of
    different tasks that share no file of a model, or without any parameter in common.
    """
    for run in runs[1:]:
        _check_same_model(runs[0], run)
    scales = [{(name, its["scale"]) for name, its in e.coordinates.items()} for e in estimates]
    shared = {name for name, _ in reduce(set.intersection, scales)}
    if not shared:
        paths = ", ".join(str(run.path) for run in runs)
        raise InputError(f"no parameter is tuned in all of {paths}: compare runs of the same ones")
    axes = {name: its for name, its in estimates[0].coordinates.items() if name in shared}
    every = dict.fromkeys(name for e in estimates for name in e.coordinates)
    left_out = [name for name in every if name not in shared]
    others = [
        name
        for name, its in axes.items()
        if any(_ends(e.coordinates[name]) != _ends(its) for e in estimates)
    ]
    notes = [f"not tuned alike in all runs, so not compared: {cut(left_out, _MOST_NAMED)}"]
    notes = notes * bool(left_out)
    if others:
        notes.append(f"of other bounds in some runs: {cut(others, _MOST_NAMED)}")
    return [e.along(axes) for e in estimates], notes


def _check_same_model(a: RunData, b: RunData) -> None:
    """Raises InputError for different tasks, but for tuning files of one model."""
    tasks = a.result["task"], b.result["task"]
    if tasks[0] != tasks[1] and not _model_files(a) & _model_files(b):
        raise InputError(
            f"{a.path} is of {tasks[0]}, {b.path} of {tasks[1]}: compare runs of one task, or of "
            "tuning files of one model"
        )


def _model_files(run: RunData) -> set[str]:
    """Digests of the run's copies of what its tuning file names, such as the model."""
    files = (path for path in (run.path / SOURCES).rglob("*") if path.is_file())
    return {
        sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.suffix != ".toml" and "__pycache__" not in path.parts
    }


def _ends(coordinates: dict[str, Any]) -> tuple[float, float]:
    """Both bounds along the scale."""
    low, high = coordinates["low"], coordinates["high"]
    return (
        (np.log(max(low, 1e-300)), np.log(high)) if coordinates["scale"] == "log" else (low, high)
    )
