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
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import tyro
from common import kept_in, machine, record_figures
from two_arms import sysid
from two_arms.score import print_table, rows, score
from two_arms.settings import WorldSettings
from two_arms.world import World, film

from simtune.config import TuneConfig
from simtune.errors import InputError
from simtune.real.observed import observed, open_recordings
from simtune.run.files import read_json, write_json
from simtune.tasks import Task, load_task

Method = Literal["video", "readings", "both", "mujoco.sysid"]
METHODS: tuple[Method, ...] = ("video", "readings", "both", "mujoco.sysid")
_OBSERVE = {"video": "cameras", "readings": "joints", "both": "cameras,joints"}
_SHOWN_BY_VIDEO = ("box_mass", "box_friction")
_PLAIN_TUNE = (sys.executable, "-c", "from simtune.cli import main; main()", "tune")
_QUICK_TUNE = (
    sys.executable,
    "-m",
    "whole.variants",
    "--quick",
    "tune",
)  # found beside this file


@dataclass(frozen=True, kw_only=True)
class Settings(WorldSettings):
    """Measure it."""

    methods: tuple[Method, ...] = METHODS
    """What is compared."""
    out: Path = Path("runs/aloha")
    """Folder for the recordings and the runs."""
    quick: bool = False
    """A search that finds nothing, by readings and both of two short episodes."""


def main(settings: tyro.conf.OmitArgPrefixes[Settings]) -> None:
    if settings.quick:
        methods: tuple[Method, ...] = ("readings", "both")
        settings = replace(settings, episodes=2, steps=24, minutes=0.1, methods=methods)
    if "mujoco.sysid" in settings.methods and not settings.quick and not find_spec("plotly"):
        sys.exit('mujoco.sysid needs pip install "mujoco[sysid]"; or name other --methods')
    try:
        task = load_task(str(settings.task))
    except InputError as error:
        sys.exit(f"{error}\nrun examples/aloha/prepare.sh first")
    assert isinstance(task, Task)
    world, scores = World.draw(task.parameters, task.sensors[0].size, settings.seed), {}
    with kept_in(settings.out, settings.quick) as out:
        settings = replace(settings, out=out / f"world-{settings.seed}")
        real = settings.out / "recordings"
        if not real.exists():
            film(task, world, real, settings.episodes, settings.steps, settings.seed)
        for method in settings.methods:
            if result := _result(method, settings, task):
                scores[method] = score(task, world, result)
    table = rows(task, settings.seed, scores)
    print_table(table)
    if not settings.quick:
        record_figures(settings.record, ["world", "parameter"], table)
    about = {"benchmark": "aloha", "quick": settings.quick, **machine()}
    print(json.dumps({**about, "methods": scores}))
    if len(scores) < len(settings.methods):
        sys.exit("some did not end well")


def _result(method: Method, settings: Settings, task: Task) -> dict[str, Any] | None:
    """What a method makes of recordings, now or before; None where it fails."""
    real, out = settings.out / "recordings", settings.out / method
    path = out / "result.json"
    if path.exists():
        print(f"{out} is finished: scoring it", file=sys.stderr)
    elif method == "mujoco.sysid":
        config = TuneConfig(task=str(settings.task), real=str(real), out=out, observe="joints")
        seen = observed(task, config.observed, is_simulated=False)
        dataset = open_recordings(real, task, config, 64, seen)
        trajectories = [dataset.read(i) for i in range(dataset.num_episodes)]
        out.mkdir(parents=True, exist_ok=True)
        write_json(path, sysid.fit(task, trajectories, _SHOWN_BY_VIDEO))
    elif _tune(_OBSERVE[method], settings, out):
        return None
    return read_json(path)


def _tune(observe: str, settings: Settings, out: Path) -> int:
    """The command's exit status."""
    command = [*(_QUICK_TUNE if settings.quick else _PLAIN_TUNE), str(settings.task), "--real"]
    command += [str(settings.out / "recordings"), "--observe", observe, "--out", str(out)]
    command += ["--seed", str(settings.seed), "--budget-minutes", str(settings.minutes)]
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    print(f"{observe}: {' '.join(command[-10:])}", file=sys.stderr)
    return subprocess.run(command, stdout=sys.stderr, env=environment).returncode


if __name__ == "__main__":
    tyro.cli(main)
