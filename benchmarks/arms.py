"""Servos of arms out of other people's wheels, found from joint readings alone.

Each arm (Kinova's Jaco of dm_control, I2RT's YAM and the Unitree G1's right arm of mjlab, Franka's
Panda of gym-hil, a ViperX of gym-aloha) gets servos whose stiffness, damping, torque limit, lag and
delay, and whose joints' armature, damping, dry friction and offset differ from the model's by up to
a factor of two, drawn from a seed. Six episodes of smooth random commands are recorded, with an
encoder's noise, and tuned to by the plain command's own function. The last line is one JSON object.
"""

import json
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from common import machine, record_figures
from wheel_arms import ARMS, NOISE, STEP_S, Arm, middle, tuning_file, unpack, wandering

from simtune.config import TuneConfig
from simtune.recordings import write_dataset
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory
from simtune.tuning_run import tune

_EPISODES, _STEPS = 6, 250


def main(
    arms: tuple[str, ...] = tuple(ARMS),
    seeds: tuple[int, ...] = (0,),
    minutes: float = 5.0,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        arms: Of jaco, yam, g1, panda, viperx.
        seeds: Of truths, starts and commands.
        minutes: Each run's --budget-minutes.
        record: Write the figures into this file of docs/results, too.
        quick: The arm that needs no download.
    """
    rows = []
    for name in arms[:1] if quick else arms:
        for seed in seeds:
            with TemporaryDirectory() as folder:
                rows += _run(name, seed, minutes, Path(folder))
    for row in rows:
        print(row)
    known = [row for row in rows if row["verdict"] == "identified"]
    figures = {
        "parameters": len(rows),
        "held": round(sum(row["holds"] for row in rows) / len(rows), 3),
        "identified": len(known),
        "identified_within_5_percent": sum(row["percent_error"] <= 5 for row in known),
        "largest_identified_percent_error": max((r["percent_error"] for r in known), default=None),
    }
    runs = [[r for r in rows if (r["arm"], r["seed"]) == its] for its in _runs(rows)]
    record_figures(record, ["arm", "seed"], [_summary(its) for its in runs])
    print(json.dumps({"benchmark": "arms", "quick": quick, **machine(), **figures}))


def _runs(rows: list[dict[str, Any]]) -> list[tuple[str, int]]:
    return list(dict.fromkeys((row["arm"], row["seed"]) for row in rows))


def _summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Of one run, as docs/results shows it."""
    known = [row for row in rows if row["verdict"] == "identified"]
    return {
        **{key: rows[0][key] for key in ("arm", "seed", "seconds")},
        "parameters": len(rows),
        "held": sum(row["holds"] for row in rows),
        "identified": len(known),
        "largest": max((row["percent_error"] for row in known), default=0.0),
        "identified_missed": [row["parameter"] for row in known if not row["holds"]],
    }


def _run(name: str, seed: int, minutes: float, folder: Path) -> list[dict[str, Any]]:
    """A row for each parameter."""
    arm, rng = ARMS[name], np.random.default_rng((seed, len(name)))
    unpack(arm, folder / "model")
    file = folder / "tune.toml"
    file.write_text(tuning_file(arm))
    task = load_task(str(file))
    space = task.parameters
    share = rng.uniform(-1, 1, len(space))
    truth = np.where(space.nominal > 0, space.nominal * 2.0**share, 0.06 * share)
    truth[list(space.names).index("delay")] = rng.uniform(0, 0.08)
    _record(task, arm, space.clip(truth), rng, folder / "real")
    began_s = time.monotonic()
    config = TuneConfig(
        task=str(file), real=str(folder / "real"), out=folder / "run", budget_minutes=minutes,
        seed=seed,
    )  # fmt: skip
    result = tune(config)
    seconds = round(time.monotonic() - began_s, 1)
    return [
        _row(name, seed, parameter, value, result["parameters"][parameter], seconds)
        for parameter, value in space.to_dict(space.clip(truth)).items()
    ]


def _row(
    arm: str, seed: int, parameter: str, truth: float, found: dict[str, Any], seconds: float
) -> dict[str, Any]:
    # What may be 0 is measured by a usual size of it.
    scale = {"delay": 0.1}.get(parameter, 0.1 if "offset" in parameter else truth)
    return {
        "arm": arm,
        "seed": seed,
        "parameter": parameter,
        "truth": round(truth, 5),
        "mean": round(found["mean"], 5),
        "percent_error": round(100 * abs(found["mean"] - truth) / scale, 2),
        "holds": bool(found["low"] <= truth <= found["high"]),
        "verdict": found["verdict"],
        "seconds": seconds,
    }


def _record(
    task: Task, arm: Arm, truth: np.ndarray, rng: np.random.Generator, folder: Path
) -> None:
    """Smooth random commands around a pose within the joints' limits, and what encoders read."""
    around = wandering((_EPISODES, _STEPS, len(arm.joints)), 12, rng)
    actions = middle(task, arm.joints) + around
    actions[1::2] = actions[1::2, (np.arange(_STEPS) // 40) * 40]  # half of them in steps
    worlds = np.repeat(truth[None], _EPISODES, 0)
    sensor = task.sensors[0]

    def start_at_command(batch, _: np.random.Generator) -> None:
        batch.qpos[:] = actions[:, 0]

    simulator = replace(task, initialize=start_at_command).simulator(image_size=16)
    played = simulator.roll_out(worlds, actions, rng, sensor.observe)
    assert len(played) == _EPISODES, "an episode diverged"
    readings = played.observed + NOISE * rng.normal(size=played.observed.shape)
    nothing = np.empty((_STEPS + 1, 0, 0, 3), np.uint8)
    write_dataset(
        folder,
        [
            Trajectory(nothing, a.astype(np.float32), STEP_S, {sensor.name: r})
            for a, r in zip(actions, readings, strict=True)
        ],
        action_names=[f"{joint}_servo" for joint in arm.joints],
        robot_type="simulated",
        task="smooth random commands",
        reading_names={sensor.name: list(arm.joints)},
    )


if __name__ == "__main__":
    tyro.cli(main)
