"""Two arms of meshes that push a box: from video, from joint readings, from both.

A world of examples/aloha differs from its scene by up to ×2 in each parameter. It is filmed by
OpenGL with shadows (six episodes of 200 steps, each arm sweeping over the table once), with joint
readings that have noise and offsets, and with arms that follow a step late. `simtune tune` looks at
its video alone, at its readings alone, and at both; `mujoco.sysid` fits the same readings
(pip install "mujoco[sysid]"; --methods without it where that is not there).

The world is drawn from --seed; each method's result is a file in OUT, and is not measured again.
Prints a table in Markdown; the last line is one JSON object.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from common import machine, record_figures
from two_arms import sysid
from two_arms.world import World, film

from simtune.config import TuneConfig
from simtune.errors import InputError
from simtune.real.choose import observed, open_recordings
from simtune.real.truth import Truth
from simtune.run.files import read_json, write_json
from simtune.tasks import Task, load_task

Method = Literal["video", "readings", "both", "mujoco.sysid"]
METHODS: tuple[Method, ...] = ("video", "readings", "both", "mujoco.sysid")
_OBSERVE = {"video": "cameras", "readings": "joints", "both": "cameras,joints"}
_SHOWN_BY_VIDEO = ("box_mass", "box_friction")
_TUNE = (sys.executable, "-c", "from simtune.cli import main; main()", "tune")
_QUICK_TUNE = (sys.executable, "-m", "whole.variants", "--quick", "tune")  # found beside this file


def main(
    task: Path = Path("examples/aloha/tune.toml"),
    seed: int = 0,
    methods: tuple[Method, ...] = METHODS,
    minutes: float = 10.0,
    episodes: int = 6,
    steps: int = 200,
    out: Path = Path("runs/aloha"),
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        task: The example's tuning file; examples/aloha/prepare.sh unpacks its scene.
        seed: Of the world and of what the arms do.
        methods: What is compared.
        minutes: Each run's --budget-minutes.
        episodes: Of the world.
        steps: Of each episode.
        out: Folder for the recordings and the runs.
        record: Write the figures into this file of docs/results, too.
        quick: A search that finds nothing, by readings and both of two short episodes.
    """
    try:
        loaded = load_task(str(task))
    except InputError as error:
        sys.exit(f"{error}\nrun examples/aloha/prepare.sh first")
    assert isinstance(loaded, Task)
    with tempfile.TemporaryDirectory() as temporary:
        if quick:
            episodes, steps, minutes, out = 2, 24, 0.1, Path(temporary)
            methods = tuple(m for m in methods if m in ("readings", "both"))
        folder = out / f"world-{seed}"
        world = World.draw(loaded.parameters, loaded.sensors[0].size, seed)
        real = folder / "recordings"
        if not real.exists():
            film(loaded, world, real, episodes, steps, seed)
        scores = {}
        for method in methods:
            result = _result(method, task, loaded, real, folder / method, seed, minutes, quick)
            scores[method] = _score(loaded, world, result) if result else None
    scores = {method: its for method, its in scores.items() if its}
    rows = _rows(loaded, seed, scores)
    _print_table(rows)
    if not quick:
        record_figures(record, ["world", "parameter"], rows)
    print(json.dumps({"benchmark": "aloha", "quick": quick, **machine(), "methods": scores}))
    if len(scores) < len(methods):
        sys.exit("some did not end well")


def _result(
    method: Method,
    task: Path,
    loaded: Task,
    real: Path,
    out: Path,
    seed: int,
    minutes: float,
    quick: bool,
) -> dict[str, Any] | None:
    """What a method makes of recordings, now or before; None where it fails."""
    path = out / "result.json"
    if path.exists():
        print(f"{out} is finished: scoring it", file=sys.stderr)
    elif method == "mujoco.sysid":
        config = TuneConfig(task=str(task), real=str(real), out=out, observe="joints")
        seen = observed(loaded, config.observed, is_simulated=False)
        dataset = open_recordings(real, loaded, config, 64, seen)
        trajectories = [dataset.read(i) for i in range(dataset.num_episodes)]
        out.mkdir(parents=True, exist_ok=True)
        write_json(path, sysid.fit(loaded, trajectories, _SHOWN_BY_VIDEO))
    else:
        command = [*(_QUICK_TUNE if quick else _TUNE), str(task), "--real", str(real)]
        command += ["--observe", _OBSERVE[method], "--out", str(out), "--seed", str(seed)]
        command += ["--budget-minutes", str(minutes)]
        paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
        print(f"{method}: {' '.join(command[-10:])}", file=sys.stderr)
        if subprocess.run(command, stdout=sys.stderr, env=environment).returncode:
            return None
    return read_json(path)


def _score(task: Task, world: World, result: dict[str, Any]) -> dict[str, Any]:
    """Percent errors, and whether 90 % intervals hold, of what the method has an estimate of."""
    found, space = result["parameters"], task.parameters
    mean = np.array([found[n]["mean"] if n in found else np.nan for n in space.names])
    real, percent = Truth(space, world.parameters).score(mean)
    parameters = {}
    for name, true, error in zip(space.names, real, percent, strict=True):
        if name in found:
            low, high = (found[name][end] for end in ("low", "high"))  # null: no interval
            parameters[name] = {
                "percent_error": round(float(error), 1),
                "holds": None if low is None else bool(low <= true <= high),
                "verdict": found[name].get("verdict"),
                "true": float(true),
                **{key: found[name][key] for key in ("mean", "low", "high")},
            }
    return {
        "seconds": round(result["wall_s"]),
        "warnings": result["warnings"],
        "parameters": parameters,
    }


def _rows(task: Task, seed: int, scores: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """One a parameter, and one of the time; a column a method."""
    rows: list[dict[str, Any]] = []
    for name in task.parameters.names:
        row: dict[str, Any] = {"world": seed, "parameter": name}
        for method, score in scores.items():
            its = score["parameters"].get(name)
            row[method.replace(".", "_")] = _words(its) if its else "–"
        rows.append(row)
    seconds = {m.replace(".", "_"): f"{score['seconds']} s" for m, score in scores.items()}
    return [*rows, {"world": seed, "parameter": "time", **seconds}]


def _words(its: dict[str, Any]) -> str:
    """Error, half of the interval in percent of the estimate, whether that holds, and a verdict."""
    words = [f"{its['percent_error']} %"]
    if its["holds"] is None:
        words.append("no interval")
    elif its["verdict"] != "not identifiable":
        half = 50 * (its["high"] - its["low"]) / max(abs(its["mean"]), 1e-9)
        words.append(f"±{half:.2g} % {'holds' if its['holds'] else '**misses**'}")
    return ", ".join([*words, *filter(None, [its["verdict"]])])


def _print_table(rows: list[dict[str, Any]]) -> None:
    columns = [key for key in rows[0] if key != "world"]
    print("| " + " | ".join(columns) + " |")
    print("|" + "---|" * len(columns))
    for row in rows:
        print("| " + " | ".join(str(row.get(key, "–")) for key in columns) + " |")


if __name__ == "__main__":
    tyro.cli(main)
