"""Which motions tell what of a servo and its joint: as much as joint readings can, at best.

An arm out of other people's wheels (benchmarks/arms.py) is moved in five ways, four episodes of
eight seconds each. Fisher's information of the readings says how well each parameter could be
told, with what errors every reading is taken to have: 1 mrad, that go with each other for a
second. The last line is one JSON object.
"""

import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tyro
from common import machine, record_figures
from wheel_arms import ARMS, STEP_S, middle, tuning_file, unpack, wandering

from simtune.checking.sensitivity.parameters import where_analyzed
from simtune.checking.sensitivity.reading_changes import ReplayedReadings
from simtune.observation import ObservationModel
from simtune.tasks import Task, load_task

_EPISODES, _STEPS = 4, 400
_ERROR, _TOGETHER_S = 1e-3, 1.0
_NOTHING = 1.0  # of the whole range
_STEEP = 3.0  # times as far and as fast: what brings a servo to its limit


def main(arm: str = "yam", record: Path | None = None, quick: bool = False) -> None:
    """Measure it.

    Args:
        arm: Of jaco, yam, g1.
        record: Write the figures into this file of docs/results, too.
        quick: One motion.
    """
    with TemporaryDirectory() as folder:
        its, file = ARMS[arm], Path(folder) / "tune.toml"
        unpack(its, Path(folder) / "model")
        file.write_text(tuning_file(its))
        task = load_task(str(file))
        assert isinstance(task, Task)
        rng, mid, rows = np.random.default_rng(0), middle(task, its.joints), []
        motions = list(_motions(len(its.joints), rng).items())
        for name, motion in motions[: 1 if quick else None]:
            rows.append({"arm": arm, "motion": name, **_told(task, mid + motion)})
            print(rows[-1])
    record_figures(record, ["arm", "motion"], rows)
    print(json.dumps({"benchmark": "motions", "quick": quick, **machine(), "motions": len(rows)}))


def _motions(count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """{what: (E, T, A) around the middle}."""
    shape = (_EPISODES, _STEPS, count)

    quick = wandering(shape, 12, rng)
    turn = np.arange(_STEPS)[:, None] * count // _STEPS == np.arange(count)
    one_by_one = quick * turn
    held = quick[:, (np.arange(_STEPS) // 50) * 50]
    return {
        "slow: a turn in ten seconds": wandering(shape, 100, rng),
        "quick: a turn in a second": quick,
        "quick, one joint after the other": one_by_one,
        "steps, held for a second": held,
        "steps of three times the size": _STEEP * held,
    }


def _told(task: Task, actions: np.ndarray) -> dict[str, float | None]:
    """{parameter: standard deviation, percent of it; of an offset mrad, of a delay ms}.

    None of one that does not show.
    """

    def start(batch, _: np.random.Generator) -> None:
        batch.qpos[:] = actions[: batch.nsim, 0]

    simulator = replace(task, initialize=start, cameras=()).simulator(image_size=16, step_s=STEP_S)
    observation = ObservationModel.of_reality(task.sensors).only(("joints",))
    nominal = where_analyzed(simulator.space)
    replayed = ReplayedReadings(simulator, observation, nominal, actions)
    noise = np.full(actions.shape[-1], _ERROR * np.sqrt(_TOGETHER_S / STEP_S))
    space = simulator.space
    changed = np.repeat(nominal[None], len(space), 0)
    information = replayed.changes(changed, noise).information
    std = np.sqrt(np.diag(np.linalg.inv(information + 1e-4 * np.eye(len(space)))))
    moved = space.from_unit(np.clip(space.to_unit(nominal) + 1e-4, 0, 1))
    per_unit = np.abs(moved - nominal) / 1e-4
    scale = np.where(nominal > 0, 100 / np.maximum(np.abs(nominal), 1e-12), 1000.0)
    told = zip(space.names, std, std * per_unit * scale, strict=True)
    return {name: float(f"{value:.3g}") if its < _NOTHING else None for name, its, value in told}


if __name__ == "__main__":
    tyro.cli(main)
