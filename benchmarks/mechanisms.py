"""Mechanisms that nobody drew, filmed by OpenGL: how far off, and whether intervals hold.

Each is random (random_mechanism.py): so are its truth, its camera, its light and what its user
guesses. MuJoCo and its renderer alone film five episodes of 100 steps, with shadows and smooth
edges, into mp4, with actions in csv. In four of ten the user's camera is a little aside. Then the
plain command's own function tunes the user's model. Each run's line is beside its films as it ends;
a world that has one is not tuned to again. The last line is one JSON object.
"""

import csv
import json
import os
from datetime import date
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")

import av
import mujoco
import numpy as np
import tyro
from common import commit, kept_in, machine, record_figures
from random_mechanism import Mechanism, random_mechanism

from simtune.config import TuneConfig
from simtune.tuning_run import tune

_EPISODES, _STEPS = 5, 100
_NOISE = 1.5  # of 255 levels, of a camera


def main(
    seeds_from: int = 0,
    worlds: int = 10,
    minutes: float = 6.0,
    out: Path = Path("runs/mechanisms"),
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        seeds_from: The first world's seed; others follow.
        worlds: How many.
        minutes: Each run's --budget-minutes.
        out: Films and runs are kept here.
        record: Write the figures into this file of docs/results, too.
        quick: Film one world, tune nothing.
    """
    lines = list[dict[str, Any]]()
    for seed in range(seeds_from, seeds_from + (1 if quick else worlds)):
        with kept_in(out / str(seed), quick) as folder:
            line = folder / "line.json"
            if not line.exists():
                mechanism = random_mechanism(seed)
                _write(mechanism, folder, seed)
                if quick:
                    continue
                line.write_text(json.dumps(_score(mechanism, folder, seed, minutes)))
            lines.append(json.loads(line.read_text()))
            print(lines[-1], flush=True)
    record_figures(record, ["seed"], [_row(line) for line in lines])
    held = [holds for line in lines for holds in line["holds"].values()]
    figures = {"worlds": len(lines), "intervals": len(held), "held": sum(held)}
    print(json.dumps({"benchmark": "mechanisms", "quick": quick, **machine(), **figures}))


def _row(line: dict[str, Any]) -> dict[str, Any]:
    """A row of the claim's table: of the motion each error, of colours their median."""
    errors, verdicts = line["percent_errors"], line["verdicts"]
    colours = [name for name in errors if name[-2:] in ("_r", "_g", "_b")]
    of_motion = [name for name in errors if name not in colours]
    told = (f"{n} {abs(errors[n]):.1f} (±{line['half_widths'][n]:.1f})" for n in of_motion)
    return {
        "seed": line["seed"],
        "kind": line["kind"],
        "camera": "aside, a parameter" if line["camera_aside"] else "right",
        "errors": ", ".join(told),
        "identified": f"{sum(verdicts[n] == 'identified' for n in of_motion)} of {len(of_motion)}",
        "colours": round(float(np.median([abs(errors[n]) for n in colours])), 1),
        "held": f"{sum(line['holds'].values())} of {len(line['holds'])}",
        "seconds": line["wall_s"],
        "commit": line["commit"],
        "date": line["date"],
    }


def _write(mechanism: Mechanism, folder: Path, seed: int) -> None:
    """The user's files, and in real/ the film of the true world."""
    (folder / "scene.xml").write_text(mechanism.model)
    (folder / "world.xml").write_text(mechanism.world)
    (folder / "tune.toml").write_text(mechanism.tuning_file)
    (folder / "truth.json").write_text(json.dumps(mechanism.truth, indent=1))
    (folder / "real").mkdir(exist_ok=True)
    rng = np.random.default_rng([seed, 1])
    for episode in range(_EPISODES):
        frames, actions = _film(mechanism, rng)
        _write_video(folder / "real" / f"{episode}.mp4", frames, 1 / mechanism.step_s)
        with (folder / "real" / f"{episode}.csv").open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow([f"motor_{i}" for i in range(actions.shape[1])])
            rows.writerows(np.round(actions, 6).tolist())


def _film(mechanism: Mechanism, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(T + 1, H, W, 3) frames and (T, A) actions that wander."""
    model = mujoco.MjModel.from_xml_string(mechanism.world)
    data = mujoco.MjData(model)
    for name, far in mechanism.starts.items():
        data.joint(name).qpos[0] = rng.uniform(-far, far)
    low, high = model.actuator_ctrlrange.T
    times = np.arange(_STEPS) * mechanism.step_s
    hz, phase = rng.uniform(0.2, 1.2, (2, 3, 1, model.nu)), rng.uniform(0, 6.3, (3, 1, model.nu))
    waves = np.sin(2 * np.pi * hz[0] * times[:, None] + phase).mean(0)
    actions = (low + high) / 2 + (high - low) / 2 * np.clip(1.6 * waves, -1, 1)
    substeps, frames = round(mechanism.step_s / model.opt.timestep), []
    with mujoco.Renderer(model, *mechanism.shape) as renderer:
        mujoco.mj_forward(model, data)
        for step in range(_STEPS + 1):
            renderer.update_scene(data, "front")
            seen = renderer.render() + rng.normal(0, _NOISE, (*mechanism.shape, 3))
            frames.append(np.clip(np.round(seen), 0, 255).astype(np.uint8))
            if step < _STEPS:
                data.ctrl = actions[step]
                # As films often are made: what is drawn next is a physics step old.
                mujoco.mj_step(model, data, substeps)
    return np.stack(frames), actions


def _write_video(path: Path, frames: np.ndarray, fps: float) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=round(fps), options={"crf": "18"})
        stream.height, stream.width = frames.shape[1:3]
        stream.pix_fmt = "yuv420p"
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, "rgb24")))
        container.mux(stream.encode())


def _score(mechanism: Mechanism, folder: Path, seed: int, minutes: float) -> dict[str, Any]:
    config = TuneConfig(
        task=str(folder / "tune.toml"),
        real=str(folder / "real"),
        out=folder / "run",
        budget_minutes=minutes,
        seed=seed,
    )
    result, truth = tune(config), mechanism.truth
    found = {name: result["parameters"][name] for name in truth}
    half = {name: (its["high"] - its["low"]) / 2 for name, its in found.items()}
    return {
        "seed": seed,
        "kind": mechanism.kind,
        "camera_aside": mechanism.is_aside,
        "commit": commit(),
        "date": date.today().isoformat(),
        "wall_s": round(result["wall_s"]),
        "percent_errors": {
            n: _percent(its["mean"] - truth[n], truth[n]) for n, its in found.items()
        },
        "half_widths": {name: _percent(half[name], truth[name]) for name in found},
        "verdicts": {name: its["verdict"] for name, its in found.items()},
        "holds": {n: bool(its["low"] <= truth[n] <= its["high"]) for n, its in found.items()},
        "warnings": result["warnings"],
    }


def _percent(off: float, of: float) -> float:
    return float(f"{100 * off / of:.3g}")


if __name__ == "__main__":
    tyro.cli(main)
