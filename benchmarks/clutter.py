"""Video before a clutter that no model has: with and without its picture behind what moves.

The example cart_pendulum among fourteen random boxes, balls and cylinders, filmed by OpenGL with
shadows, through mp4, with dynamics that differ by up to a factor of two. It is tuned to by the
plain command's own function with the example's model, which knows nothing of all that: with
background = "recording", and for comparison without. The last line is one JSON object.
"""

import json
import os
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from common import machine, record_figures

from simtune.config import RecordConfig, TuneConfig
from simtune.filming import record as film
from simtune.tasks import load_task
from simtune.tuning_run import tune

_EXAMPLE = Path(__file__).parents[1] / "examples" / "cart_pendulum"
_THINGS, _EPISODES = 14, 6
_DYNAMICS = ("bob_mass", "hinge_damping", "block_friction", "drive_gear")
_PLATE = '[camera]\ncamera = "front"\nbackground = "recording"\n\n[actions]'


def main(
    seeds: tuple[int, ...] = (0, 1, 2),
    minutes: float = 6.0,
    compare: bool = True,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        seeds: Of clutters, truths and commands.
        minutes: Each run's --budget-minutes.
        compare: Tune without the background as well.
        record: Write the figures into this file of docs/results, too.
        quick: Film and look at one clutter, tune nothing.
    """
    rows: list[dict[str, Any]] = []
    for seed in seeds[:1] if quick else seeds:
        with TemporaryDirectory() as folder:
            truth = _film(Path(folder), seed)
            for plated in () if quick else (True, False) if compare else (True,):
                rows.append(_score(Path(folder), truth, seed, plated, minutes))
                print(rows[-1], flush=True)
    record_figures(record, ["seed", "background"], rows)
    own = [row for row in rows if row["background"]]
    errors = [error for row in own for error in row["percent_errors"].values()]
    figures = {
        "scenes": len(own),
        "mean_percent_error": round(float(np.mean(errors)), 2) if errors else None,
        "held": round(float(np.mean([row["held"] for row in own])), 3) if own else None,
    }
    print(json.dumps({"benchmark": "clutter", "quick": quick, **machine(), **figures}))


def _film(folder: Path, seed: int) -> dict[str, float]:
    """Recordings of the world in FOLDER/real, and its dynamics."""
    rng = np.random.default_rng(seed)
    for name in ("scene.xml", "tune.toml", "policy.py"):
        shutil.copy(_EXAMPLE / name, folder)
    space = load_task(str(folder / "tune.toml")).parameters
    nominal = dict(zip(space.names, space.nominal, strict=True))
    truth = {name: float(nominal[name] * 2 ** rng.uniform(-1, 1)) for name in _DYNAMICS}
    (folder / "truth.json").write_text(json.dumps(truth))
    scene = (folder / "scene.xml").read_text()
    things = "\n".join(_thing(rng) for _ in range(_THINGS))
    (folder / "scene.xml").write_text(scene.replace("</worldbody>", f"{things}\n</worldbody>"))
    config = RecordConfig(
        task=str(folder / "tune.toml"),
        out=folder / "real",
        episodes=_EPISODES,
        parameters=folder / "truth.json",
        renderer="opengl",
        seed=seed,
    )
    film(config)
    shutil.copy(_EXAMPLE / "scene.xml", folder)
    return truth


def _thing(rng: np.random.Generator) -> str:
    """A geom behind the cart, that nothing touches."""
    kind = rng.choice(["box", "sphere", "cylinder", "capsule"])
    place = rng.uniform([-1.2, 0.35, 0.05], [1.2, 1.3, 1.0])
    size, turn, colour = rng.uniform(0.05, 0.22, 3), rng.uniform(-90, 90, 3), rng.uniform(0, 1, 3)
    said = (" ".join(f"{v:.3f}" for v in values) for values in (place, size, turn, colour))
    return '<geom type="{}" pos="{}" size="{}" euler="{}" rgba="{} 1"/>'.format(kind, *said)


def _score(
    folder: Path, truth: dict[str, float], seed: int, plated: bool, minutes: float
) -> dict[str, Any]:
    text = (_EXAMPLE / "tune.toml").read_text()
    if plated:
        text = text.replace('camera = "front"\n', "").replace("[actions]", _PLATE)
    (folder / "tune.toml").write_text(text)
    config = TuneConfig(
        task=str(folder / "tune.toml"),
        real=str(folder / "real"),
        out=folder / f"run-{plated}",
        budget_minutes=minutes,
        seed=seed,
    )
    result = tune(config)
    found = {name: result["parameters"][name] for name in truth}
    holds = [its["low"] <= truth[name] <= its["high"] for name, its in found.items()]
    return {
        "seed": seed,
        "background": plated,
        "percent_errors": {
            n: round(100 * abs(its["mean"] / truth[n] - 1), 1) for n, its in found.items()
        },
        "verdicts": {name: its["verdict"] for name, its in found.items()},
        "held": float(np.mean(holds)),
        "warned": bool(result["warnings"]),
        "seconds": round(result["wall_s"]),
        "cores": len(os.sched_getaffinity(0)),
    }


if __name__ == "__main__":
    tyro.cli(main)
