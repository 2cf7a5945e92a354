"""Draws from a run's joint posterior as a table, for a user's own domain randomisation."""

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.parameters import ParameterSpace
from simtune.random_streams import Purpose, stream
from simtune.run.files import write_atomically
from simtune.run_data import RunData
from simtune.tuning.estimate import Estimate
from simtune.tuning.joint import Joint


def draw_samples(run: RunData, space: ParameterSpace, num: int) -> np.ndarray:
    """(num, N) parameters within their bounds, the same in every call.

    Raises InputError for a run of an earlier version of simtune, or with damaged files.
    """
    if "seed" not in run.result:
        raise InputError(f"{run.path / 'result.json'} is damaged: it has no seed")
    if run.posterior is None:
        raise InputError(
            f"{run.path} has no posterior.npz, since an earlier version wrote it: give its command "
            "once more"
        )
    found = [run.result["parameters"][name] for name in space.names]
    mean, low, high = (np.array([p[key] for p in found], float) for key in ("mean", "low", "high"))
    verdicts = [p["verdict"] for p in found]
    curves, correlation = run.survival_curves(), run.posterior.correlation
    estimate = Estimate(mean, low, high, verdicts, curves, correlation)
    return Joint.of(estimate, space).draw(num, stream(run.result["seed"], Purpose.POSTERIOR))


def write_samples(path: Path, names: Sequence[str], draws: np.ndarray) -> None:
    """Write (num, N) draws as CSV with a header, NPZ of `names` and `draws`, or a list in JSON."""
    if path.suffix == ".npz":
        file = io.BytesIO()
        np.savez_compressed(file, names=np.array(names), draws=draws)
        content = file.getvalue()
    elif path.suffix == ".json":
        rows = [dict(zip(names, row, strict=True)) for row in draws.tolist()]
        content = json.dumps(rows, indent=1) + "\n"
    else:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([names, *draws.tolist()])
        content = text.getvalue()
    write_atomically(path, content)
