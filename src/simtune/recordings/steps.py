"""Resamples an episode to equal steps, and checks that this is possible."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simtune.between_rows import own_step_s, typical_step_s
from simtune.errors import InputError
from simtune.recordings.resample import find_gaps, step_actions, step_readings, step_times
from simtune.recordings.source import MOST_ROWS, Reading, Rows, first_wrong, short
from simtune.recordings.time_stamps import jump

_LARGEST_READING = 1e9  # larger than any joint reading in any unit, counts of encoders too


@dataclass(frozen=True)
class Steps:
    """K steps; a frame is due at the start of each step and at the end of the last."""

    times_s: np.ndarray  # (K + 1,)
    actions: np.ndarray  # (K, A) float32
    readings: Mapping[str, np.ndarray]  # {sensor: (K + 1, D) float64}
    gaps_s: Sequence[tuple[float, float]]  # in which an action is held since rows are missing
    unused_s: float  # for which the pictures go on after the last action
    unfilmed: int  # last rows for which a video has no frame
    readings_hz: float  # how often the fastest reading was measured; 0: none was


def make_steps(
    where: str, rows: Rows, step_s: float, sensors: Mapping[str, Sequence[Reading]]
) -> Steps:
    """Resample an episode's rows, whose readings are those of all sensors, one after the other.

    Raises InputError, which names the episode as `where`, if actions are not finite, or the episode
    is too short or too long.
    """
    rows = _without_last(rows)
    with np.errstate(over="ignore"):
        is_finite = np.isfinite(rows.actions.astype(np.float32))  # float32, as they are stored
    if (row := first_wrong(np.any(~is_finite, axis=1))) is not None:
        values = short([f"{value:g}" for value in rows.actions[row]])
        place = rows.lines.place(row) if rows.lines else f"{where}, row {row}"
        remedy = "drop or repair the episode"
        if rows.lines and np.isnan(rows.actions[row]).any():
            remedy = "leave cells empty where nothing new was sent: the action before is held"
        raise InputError(f"{place}: action is not finite: [{values}]; {remedy}")
    lasts_s = rows.until_s - rows.begin_s[0]
    if lasts_s > MOST_ROWS * step_s:
        remedy = jump(rows.times_s, rows.lines) or "mend them, or split the episode"
        raise InputError(
            f"{where} lasts {lasts_s:.6g} s, by its time stamps; expected at most {MOST_ROWS} "
            f"steps of {step_s:.3g} s; {remedy}"
        )
    times_s = step_times(rows, step_s)
    if len(times_s) < 2:
        raise InputError(
            f"{where} lasts {lasts_s:.3g} s; expected at least one step of "
            f"{step_s:.3g} s, a frame before and a frame after an action"
        )
    actions = step_actions(rows, times_s).astype(np.float32)
    gaps_s = find_gaps(rows.begin_s) if actions.shape[1] else []
    readings = _by_sensor(where, rows, times_s, sensors)
    readings_hz = _readings_hz(rows)
    return Steps(times_s, actions, readings, gaps_s, rows.unused_s, rows.unfilmed, readings_hz)


def _without_last(rows: Rows) -> Rows:
    """With the last but one action twice: at the last frame none is carried out, nor needed."""
    if len(rows) < 2 or rows.times_s[-1] < rows.until_s:
        return rows
    return replace(rows, actions=np.concatenate([rows.actions[:-1], rows.actions[-2:-1]]))


def _readings_hz(rows: Rows) -> float:
    own_s = [own_step_s(rows.times_s, column) for column in rows.readings.T]
    return max((1 / step_s for step_s in own_s if step_s), default=0.0)


def check_rate(where: str, rows: Rows, step_s: float) -> None:
    """Raises InputError if an episode's own rate differs from 1 / `step_s`."""
    own_hz = 1 / typical_step_s(rows.begin_s) if len(rows.begin_s) > 1 else 1 / step_s
    if abs(own_hz * step_s - 1) > 0.01:
        raise InputError(
            f"{where} has {own_hz:.4g} actions/s, the first episode {1 / step_s:.4g}; "
            "give one rate for all as --control-hz"
        )


def _by_sensor(
    where: str, rows: Rows, times_s: np.ndarray, sensors: Mapping[str, Sequence[Reading]]
) -> dict[str, np.ndarray]:
    if not sensors:
        return {}
    values = step_readings(rows, times_s)
    of_all = [reading for readings in sensors.values() for reading in readings]
    if (column := first_wrong(np.all(~np.isfinite(values), axis=0))) is not None:
        raise InputError(
            f"{where}: reading {of_all[column].full_name} is missing at every step; "
            "leave the episode out (--leave-out), or do not ask for the reading"
        )
    is_huge = np.isfinite(values) & (np.abs(np.nan_to_num(values)) > _LARGEST_READING)
    if (row := first_wrong(np.any(is_huge, axis=1))) is not None:
        column = int(is_huge[row].argmax())
        name, value = of_all[column].full_name, values[row, column]
        raise InputError(
            f"{where}, step {row}: reading {name} is {value:.3g}; "
            f"expected at most {_LARGEST_READING:g} in any unit: leave the cell empty, or drop it"
        )
    ends = np.cumsum([len(readings) for readings in sensors.values()])
    return dict(zip(sensors, np.split(values, ends[:-1], axis=1), strict=True))
