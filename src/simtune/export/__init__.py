"""`simtune export`: a run's result as files that need no simtune."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from simtune.config import ExportConfig
from simtune.errors import InputError
from simtune.export.how_sure import how_sure
from simtune.export.mjcf import tuned_model, write_mjcf
from simtune.export.samples import draw_samples, write_samples
from simtune.export.script import apply_script
from simtune.export.worlds import refuse_unfit, write_module, write_worlds
from simtune.parameters import ModelWriter, ParameterSpace
from simtune.run.files import write_atomically, write_json
from simtune.run_data import RunData, read_finished
from simtune.tasks import Task, with_model

__all__ = ["draw_samples", "export", "how_sure", "tuned_model"]

_PROVENANCE = ("command", "method", "search", "seed", "real", "real_episodes", "recordings")
_MODEL_CHECKS = ("warnings", "correlations", "combinations")


def export(config: ExportConfig) -> Path:
    """Write OUT and return its path. Raises InputError if there is nothing to export."""
    config.check()
    run = read_finished(config.run_folder)
    if not run.is_tuned:
        raise InputError(f"{run.path} is of --method {run.result['method']}, which tunes nothing")
    task = run.load_task()
    space = task.parameters
    draws = draw_samples(run, space, config.samples) if config.samples else None
    if config.is_file:
        assert draws is not None, "checked"
        return _write_file(config.out, space, draws)
    if config.format != "samples":
        refuse_unfit(space, config.format)
    task, out = with_model(task), _new_folder(config.out)
    writer, model = _write_model(run, task, out)
    if draws is not None:
        write_samples(out / "samples.csv", space.names, draws)
        if config.format != "samples":
            write_worlds(out / "worlds.npz", writer, model, draws)
            write_module(out, config.format)
    return out


def _write_model(run: RunData, task: Task, out: Path) -> tuple[ModelWriter, mujoco.MjModel]:
    """Write model.xml, apply.py and parameters.json; returns the model's writer and the model."""
    found = run.result["parameters"]
    mean = np.array([found[name]["mean"] for name in task.parameters.names])
    spec, model, writer = tuned_model(task, mean, run.result.get("step_s"))
    write_mjcf(spec, model, writer, out, task.files)
    write_atomically(out / "apply.py", apply_script(writer, model).encode())
    write_json(out / "parameters.json", _content(run, task.parameters))
    return writer, model


def _content(run: RunData, space: ParameterSpace) -> dict[str, Any]:
    """Content of parameters.json: estimates with their place in the model and bounds."""
    parameters = {
        p.name: run.result["parameters"][p.name]
        | {key: getattr(p, key) for key in ("field", "objects", "component", "scale")}
        | {"bounds": [p.low, p.high]}
        | ({"kind": p.kind} if p.kind else {})
        for p in space
    }
    provenance = {key: run.result[key] for key in _PROVENANCE if key in run.result}
    provenance |= {key: run.stored[key] for key in ("versions", "created") if key in run.stored}
    return {
        "task": run.result["task"],
        "parameters": parameters,
        **{key: run.result[key] for key in _MODEL_CHECKS if key in run.result},
        **_beside_the_model(run.result),
        "provenance": provenance | {"run": str(run.path.resolve())},
    }


def _beside_the_model(result: Mapping[str, Any]) -> dict[str, Any]:
    """What was found of the recordings, and what no model holds: delays, and sensors' offsets."""
    found = {name: result.get(f"{name}_late_s", (0.0, 0.0)) for name in ("pictures", "readings")}
    late_s, late_std_s = ({name: its[i] for name, its in found.items()} for i in (0, 1))
    late_s["actions"] = result.get("latency_steps", 0) * result.get("step_s", 0.0)
    sensors: Mapping[str, Any] = result.get("sensors", {})
    offsets = {name: its["offset"] for name, its in sensors.items()}
    return {"late_s": late_s, "late_std_s": late_std_s, "offsets": offsets}


def _write_file(path: Path, space: ParameterSpace, draws: np.ndarray) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_samples(path, space.names, draws)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    return path


def _new_folder(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write into {path}: {error.strerror}") from None
    return path
