"""A real arm's servos, from joint readings alone: how well new episodes are replayed.

Five-fold over the recordings' episodes: the tuning file's parameters are found from the others,
and each episode that was left out is replayed open loop from its first readings. Beside it stand
the untuned simulator, the bare command, the best constant delay with an offset, and the best
first-order lag with delay and offset, each fitted to the same episodes and scored on the same
others. At the end two disjoint halves of the episodes are tuned to, and their estimates compared.
The last line is one JSON object.
"""

import json
import os
import time
from pathlib import Path

import numpy as np
import tyro
from common import machine, record_figures
from scipy.optimize import minimize
from scipy.signal import lfilter

from simtune.before_after.readings import Replayed, Tuned, replay
from simtune.budget import Budget
from simtune.checking.servos.fit import delayed_by
from simtune.config import TuneConfig
from simtune.experiment.experiment import Experiment, build_experiment
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import Estimate
from simtune.tuning.readings.search import ReadingsSearch

_INTERVAL = 2 * 1.6449  # standard deviations in the central 90 %


def main(
    task: Path = Path("examples/unitree_g1/tune.toml"),
    real: Path = Path("../shared/recordings/real_g1"),
    folds: int = 5,
    minutes: float = 5.0,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        task: A tuning file whose first sensor measures what the actions command, in their order.
        real: Recordings.
        folds: Into so many parts the episodes are cut.
        minutes: At most, for each.
        record: Write the figures into this file of docs/results, too.
        quick: One fold.
    """
    config = TuneConfig(task=str(task), real=str(real), out=Path("runs/servos"), observe="joints")
    experiment = build_experiment(config)
    rms_mrad, seconds = _cross_validate(experiment, folds, 1 if quick else folds, minutes)
    for name, values in rms_mrad.items():
        print(f"{name:28s} {np.round(values, 1)}  mean {values.mean():.2f}")
    figures = _figures(rms_mrad, seconds)
    if not quick:
        figures["halves"] = _compare(experiment, *_tune_halves(experiment, minutes))
        print(f"two halves: {figures['halves']}")
    rows = [
        {"predictor": name, "rms_mrad": f"{v.round(1).tolist()}"[1:-1], "mean": f"{v.mean():.1f}"}
        for name, v in rms_mrad.items()
    ]
    record_figures(record, ["predictor"], rows)
    print(json.dumps({"benchmark": "servos", "quick": quick, **machine(), **figures}))


def _cross_validate(
    experiment: Experiment, folds: int, at_most: int, minutes: float
) -> tuple[dict[str, np.ndarray], list[float]]:
    """{predictor: (D,) root mean squares in new episodes, mrad}, and seconds of each fold."""
    episodes, left, seconds = experiment.recordings, {}, []
    for first in range(at_most):
        part = list(range(first, len(episodes), folds))
        known = [e for i, e in enumerate(episodes) if i not in part]
        began_s = time.monotonic()
        found = _tune(experiment, known, minutes)
        seconds.append(time.monotonic() - began_s)
        new = [episodes[i] for i in part]
        for name, squares in _left(experiment, known, new, found).items():
            left.setdefault(name, []).append(squares)
        print(f"fold of episodes {part}: {seconds[-1]:.0f} s", flush=True)
    return {n: 1e3 * np.sqrt(np.concatenate(v).mean(0)) for n, v in left.items()}, seconds


def _figures(rms_mrad: dict[str, np.ndarray], seconds: list[float]) -> dict[str, object]:
    """JSON."""
    return {
        "rms_mrad": {n: v.round(2).tolist() for n, v in rms_mrad.items()},
        "mean_mrad": {n: round(float(v.mean()), 2) for n, v in rms_mrad.items()},
        "to_delay": round(float(np.max(rms_mrad["tuned"] / rms_mrad["constant delay"])), 3),
        "to_lag": round(float(rms_mrad["tuned"].mean() / rms_mrad["first-order lag"].mean()), 3),
        "seconds": round(float(np.median(seconds)), 1),
        "cores": len(os.sched_getaffinity(0)),
    }


def _tune_halves(experiment: Experiment, minutes: float) -> list[Estimate]:
    """To one half of the episodes, and to the other."""
    episodes, half = experiment.recordings, len(experiment.recordings) // 2
    return [_tune(experiment, its, minutes) for its in (episodes[:half], episodes[half:])]


def _tune(experiment: Experiment, episodes: list[Trajectory], minutes: float) -> Estimate:
    """From the first guess: a later round of the same search begins where the last one ended."""
    search = ReadingsSearch(experiment.context)
    return search.run_round(episodes, Budget(60 * minutes)).estimate


def _left(
    experiment: Experiment, known: list[Trajectory], new: list[Trajectory], found: Estimate
) -> dict[str, np.ndarray]:
    """{predictor: (rows, D) squared errors in new episodes}."""
    context, (sensor, *_) = experiment.context, experiment.context.observation.sensors
    tuned = Tuned(found.mean, found.offsets, found.latency_steps, found.readings_late_s[0])
    replayed: Replayed = replay(context.simulator, context.observation, new, context.start, tuned)
    its = np.isfinite(replayed.measured).all(-1)
    squares = {
        "tuned": np.square(replayed.after - replayed.measured)[its],
        "untuned": np.square(replayed.before - replayed.measured)[its],
    }
    data, others = ([_columns(t, sensor.name) for t in part] for part in (known, new))
    for name, predict, start in (
        ("the command itself", lambda u, y, p: u, np.zeros(0)),
        ("constant delay", lambda u, y, p: delayed_by(u, abs(p[0])) + p[1], np.array([4.0, 0.0])),
        ("first-order lag", _lagging, np.array([0.5, 1.0, 0.0])),
    ):
        columns = []
        for d in range(sensor.size):
            best = _best(predict, start, [(u[:, d], y[:, d]) for u, y in data])
            errors = [predict(u[:, d], y[:, d], best) - y[:, d] for u, y in others]
            columns.append(np.square(np.concatenate(errors)))
        squares[name] = np.stack(columns, -1)
    return squares


def _columns(trajectory: Trajectory, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(T + 1, D) commands, the last one again, and readings."""
    actions = trajectory.actions.astype(float)
    return np.vstack([actions, actions[-1:]]), trajectory.readings[name]


def _lagging(command: np.ndarray, measured: np.ndarray, p: np.ndarray) -> np.ndarray:
    """x[t + 1] = x[t] + share · (u[t − delay] − x[t]) from the first reading; plus an offset."""
    share, late = 1 / (1 + np.exp(-p[0])), delayed_by(command, abs(p[1]))
    begin = np.array([(1 - share) * (measured[0] - p[2])])
    followed, _ = lfilter([share], [1, share - 1], late[:-1], zi=begin)
    return np.concatenate([[measured[0] - p[2]], followed]) + p[2]


def _best(predict, start: np.ndarray, data: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    def loss(p: np.ndarray) -> float:
        return sum(float(np.square(predict(u, y, p) - y).sum()) for u, y in data)

    if not len(start):
        return start
    begins = [np.r_[start[:-2], delay, 0.0] for delay in (0.5, 3.0, 6.0)]
    found = (minimize(loss, begin, method="Nelder-Mead") for begin in begins)
    return min(found, key=lambda its: its.fun).x


def _compare(experiment: Experiment, one: Estimate, other: Estimate) -> dict[str, object]:
    """How often the two halves' estimates differ by more than 90 % of the time they should."""
    space = experiment.space
    std = [(space.to_unit(e.high) - space.to_unit(e.low)) / _INTERVAL for e in (one, other)]
    z = (space.to_unit(one.mean) - space.to_unit(other.mean)) / np.hypot(*std)
    agree = np.abs(z) < _INTERVAL / 2
    return {
        "parameters": len(z),
        "agree": int(agree.sum()),
        "largest_z": round(float(np.abs(z).max()), 2),
        "apart": [n for n, a in zip(space.names, agree, strict=True) if not a],
    }


if __name__ == "__main__":
    tyro.cli(main)
