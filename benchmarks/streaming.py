"""Peak memory and time of `simtune check` and of what `simtune tune` reads of long recordings.

Writes a LeRobotDataset v3 of so many frames (blocks of colour that move), looks through all of it
with `check`, and takes some or all episodes as `tune` does before it begins (what it needs from
there on is `memory.py`'s); with `--tune-minutes`, also a whole `tune` to all of them. Each is a
process of its own. The last line is one JSON object.
"""

import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tyro
from common import machine, record_figures

from simtune.recordings import write_dataset
from simtune.trajectory import Trajectory

_CLI = "from simtune.cli import main; main()"
_COLLECT = """
import sys
from simtune.config import RealConfig
from simtune.real.choose import choose_real
from simtune.tasks import load_task
import simtune.tuning_run
folder, num_episodes = sys.argv[1], int(sys.argv[2])
choose_real(RealConfig(real=folder), load_task("cartpole"), 64, real_episodes=num_episodes)
"""
_STEP_S = 0.08  # cartpole's
_LIMIT_MB = 2000


def film(num_episodes: int, num_steps: int, height: int, width: int) -> Iterator[Trajectory]:
    """One episode at a time."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(40, 216, (height // 8, width // 8, 3), np.uint8)
    picture = coarse.repeat(8, 0).repeat(8, 1)
    for _ in range(num_episodes):
        shifts = rng.integers(-2, 3, num_steps + 1).cumsum()
        frames = np.stack([np.roll(picture, shift, 1) for shift in shifts])
        yield Trajectory(frames, rng.uniform(-1, 1, (num_steps, 1)).astype(np.float32), _STEP_S)


def measure(code: str, *arguments: object) -> dict[str, float]:
    """Run a program; its peak resident memory and how long it took."""
    began_s = time.monotonic()
    command = [sys.executable, "-c", code, *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{shlex.join(map(str, arguments))} failed with status {status}")
    peak_mb = usage.ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    wall_s, cpu_s = time.monotonic() - began_s, usage.ru_utime + usage.ru_stime
    return {"peak_mb": round(peak_mb), "wall_s": round(wall_s, 1), "cpu_s": round(cpu_s, 1)}


def main(
    frames: int = 50_000,
    height: int = 64,
    width: int = 64,
    episode_steps: int = 199,
    real_episodes: int = 10,
    tune_minutes: float = 0.0,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        frames: Recorded, of all episodes.
        height: Of the pictures, pixels; a multiple of 8.
        width: The same.
        episode_steps: Actions in an episode; it has a frame more.
        real_episodes: That `tune` takes, beside all.
        tune_minutes: For a whole run with all episodes, as long as it needs at least; 0: none.
        record: Write the figures into this file of docs/results, too.
        quick: 2,000 frames: within a minute.
    """
    if quick:
        frames = 2_000
    num_episodes = frames // (episode_steps + 1)
    some_episodes = min(real_episodes, num_episodes)
    with tempfile.TemporaryDirectory() as folder:
        dataset = Path(folder) / "dataset"
        trajectories = film(num_episodes, episode_steps, height, width)
        names = {"action_names": ["slide"], "robot_type": "none", "task": "noise"}
        write_dataset(dataset, trajectories, **names)
        size_mb = sum(path.stat().st_size for path in dataset.rglob("*.*")) / 1e6
        num_frames = num_episodes * (episode_steps + 1)
        measured = {
            f"simtune check, {num_frames:,} frames": measure(
                _CLI, "check", "cartpole", "--real", dataset, "--json"
            ),
            f"tune reads {some_episodes} episodes": measure(_COLLECT, dataset, some_episodes),
            f"tune reads {num_episodes} episodes": measure(_COLLECT, dataset, num_episodes),
        }
        if tune_minutes:
            asked = ["--real-episodes", num_episodes, "--budget-minutes", tune_minutes]
            run = measure(
                _CLI, "tune", "cartpole", "--real", dataset, "--out", f"{folder}/run", *asked
            )
            measured[f"tune to {num_episodes} episodes"] = run
    rows = [{"what": f"{w} of {width} × {height}", **figures} for w, figures in measured.items()]
    record_figures(record, ("what",), rows)
    facts = {"picture": [height, width], "dataset_mb": round(size_mb), "limit_mb": _LIMIT_MB}
    print(json.dumps({"frames": num_frames, **facts, "measured": measured, **machine()}))


if __name__ == "__main__":
    tyro.cli(main)
