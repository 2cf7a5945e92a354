"""Reads run folders."""

import zipfile
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.run.config import check_names_task
from simtune.run.files import read_jsonl
from simtune.run.stored import read_object
from simtune.run_data.facts import Posterior
from simtune.run_data.looked_at import RunData


def read_run(path: Path) -> RunData:
    """Read a run folder. Raises InputError if `path` is not one or its files are damaged."""
    if not (path / "config.json").is_file():
        what = "it has no config.json" if path.exists() else "there is no such folder"
        raise InputError(f"{path} is no run: {what}")
    stored = read_object(path / "config.json")
    config = stored.get("config")
    return RunData(
        path=path,
        config=config if isinstance(config, dict) else {},
        stored=stored,
        result=read_object(path / "result.json"),
        metrics=read_jsonl(path / "metrics.jsonl"),
        events=read_jsonl(path / "events.jsonl"),
        curves=read_object(path / "curves.json"),
        replay=read_object(path / "replay.json"),
        posterior=_read_posterior(path / "posterior.npz"),
    )


def read_finished(path: Path) -> RunData:
    """Read the folder of a run with a result. Raises InputError for others and damaged files."""
    return finished(read_run(path))


def finished(run: RunData) -> RunData:
    """The same. Raises InputError if it has no result, or damaged files."""
    path = run.path
    if not run.result.get("parameters"):
        raise InputError(
            f"{path} has no result yet: let the run end, or, where it was interrupted, give its "
            "command once more"
        )
    if "task" not in run.result:
        raise InputError(f"{path / 'result.json'} is damaged: it has no task")
    check_names_task(path, run.config)
    return run


def _read_posterior(path: Path) -> Posterior | None:
    """The content of posterior.npz; None if there is no such file. Raises InputError."""
    if not path.exists():
        return None
    try:
        with np.load(path) as file:
            names, draws, correlation = (file[key] for key in Posterior._fields)
        if draws.ndim != 2 or draws.shape[1] != len(names) or not np.isfinite(draws).all():
            raise ValueError(f"draws of {len(names)} parameters have the shape {draws.shape}")
        if correlation.shape != (len(names),) * 2:
            raise ValueError(f"the correlation has the shape {correlation.shape}")
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is damaged: {error}") from None
    return Posterior(tuple(names.tolist()), draws, correlation)
