"""Frames per second of physics and rendering together, against dm_control's pixel wrapper.

Both take random actions of one control timestep and draw every state, in turns within one run,
since only ratios of one run compare on a shared machine. The last line is one JSON object.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro
from common import machine, record_figures

from simtune.simulation import Simulator, random_actions
from simtune.tasks import TASKS, load_task

_NUM_WORLDS = {"cpu": 256, "cuda": 2048}  # as many as each is fast with
_DM_CONTROL_TASKS = {
    "ball_in_cup": "catch",
    "walker": "walk",
    "cheetah": "run",
    "finger": "spin",
    "cartpole": "balance",
}
# In a process of its own: dm_control chooses its OpenGL when it is imported. It prints the
# frames per second of each round of steps that it is asked for by a line on stdin.
_DM_CONTROL = """
import sys, time
import numpy as np
from dm_control import suite
from dm_control.suite.wrappers import pixels

domain, task, size = sys.argv[1], sys.argv[2], int(sys.argv[3])
settings = dict(height=size, width=size, camera_id=0)
env = pixels.Wrapper(suite.load(domain, task), render_kwargs=settings)
spec, rng = env.action_spec(), np.random.default_rng(0)
step = env.reset()
print("ready", flush=True)
for line in sys.stdin:
    num_steps, start = int(line), time.perf_counter()
    for _ in range(num_steps):
        if step.last():
            step = env.reset()
        step = env.step(rng.uniform(spec.minimum, spec.maximum))
        step.observation["pixels"]
    print(num_steps / (time.perf_counter() - start), flush=True)
"""


class DMControl:
    """dm_control's pixel wrapper with its default settings, in a subprocess."""

    def __init__(self, task: str, size: int, backend: str):
        self._process = subprocess.Popen(
            [sys.executable, "-c", _DM_CONTROL, task, _DM_CONTROL_TASKS[task], str(size)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend},
        )
        self.works = self._read() == "ready"

    def _read(self) -> str:
        return self._process.stdout.readline().strip()

    def frames_per_s(self, num_steps: int) -> float:
        self._process.stdin.write(f"{num_steps}\n")
        self._process.stdin.flush()
        return float(self._read())

    def close(self) -> str:
        """End it; the last line that it complained with, if any."""
        _, errors = self._process.communicate()
        return errors.strip().rpartition("\n")[2]


def start_dm_control(task: str, size: int) -> DMControl | None:
    if task not in _DM_CONTROL_TASKS:
        return None
    for backend in ("egl", "osmesa"):
        dm_control = DMControl(task, size, backend)
        if dm_control.works:
            return dm_control
        print(f"dm_control does not draw with {backend}: {dm_control.close()}", file=sys.stderr)
    return None


def simtune_frames_per_s(
    simulator: Simulator, num: int, num_steps: int, seed: int
) -> tuple[float, float]:
    """Step `num` worlds, each of other parameters, and draw every state; and of drawing alone."""
    rng = np.random.default_rng(seed)
    space = simulator.space
    parameters = space.from_unit(rng.uniform(0.3, 0.7, (num, len(space))))
    actions = random_actions(num, num_steps, simulator.action_mapping, rng, hold=1)
    start = time.perf_counter()
    rollouts = simulator.roll_out(parameters, actions, rng)
    played = time.perf_counter()
    frames = simulator.film(rollouts)
    ended, drawn = time.perf_counter(), frames.shape[0] * frames.shape[1]
    return drawn / (ended - start), drawn / (ended - played)


def main(
    task: str = "walker",
    size: int = 84,
    device: Literal["cpu", "cuda"] = "cpu",
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        task: One of the built-in tasks.
        size: Side of the pictures, in pixels.
        device: Where they are drawn; physics are computed on the CPU.
        record: Write the figures into this file of docs/results, too.
        quick: Fewer rounds: within a minute.
    """
    if task not in TASKS:
        sys.exit(f"no task {task!r}; there are: {', '.join(TASKS)}")
    loaded = load_task(task)
    step_s, num = loaded.control_timestep_s, _NUM_WORLDS[device]
    simulator = loaded.simulator(image_size=size, step_s=step_s, device=device)
    dm_control = start_dm_control(task, size)
    simtune_frames_per_s(simulator, num, 1, seed=0)  # compiles
    if dm_control:
        dm_control.frames_per_s(5)

    ours, drawing, theirs = [], [], []
    for round_ in range(3 if quick else 7):
        both, drawn = simtune_frames_per_s(simulator, num, num_steps=9, seed=round_)
        ours.append(both)
        drawing.append(drawn)
        if dm_control:
            theirs.append(dm_control.frames_per_s(num_steps=80))
        print(f"round {round_}: {ours[-1]:.0f} frames/s", end="", file=sys.stderr)
        print(f", dm_control {theirs[-1]:.1f}" if theirs else "", file=sys.stderr)
    if dm_control:
        dm_control.close()
    result = {
        "task": task,
        "size": size,
        "device": device,
        "frames_per_s": round(float(np.median(ours)), 1),
        "drawing_alone_frames_per_s": round(float(np.median(drawing)), 1),
        "dm_control_frames_per_s": round(float(np.median(theirs)), 2) if theirs else None,
        "ratio_to_dm_control": (
            round(float(np.median(np.divide(ours, theirs))), 1) if theirs else None
        ),
        **machine("dm_control"),
    }
    if device == "cuda":
        result["hardware"] |= {"gpu": torch.cuda.get_device_name()}
    row = {
        "what": f"rendering {task}, {size} px" + " on cuda" * (device == "cuda"),
        "unit": "frames/s",
        "ours": result["frames_per_s"],
        "other": result["dm_control_frames_per_s"],
        "ratio": result["ratio_to_dm_control"],
    }
    record_figures(record, ("what",), [row])
    print(json.dumps(result))


if __name__ == "__main__":
    tyro.cli(main)
