"""How joints follow their commands: delay, offset, residuals. No simulator is used.

A command at time t is that of the action that begins then; between two of them it is interpolated
linearly, and before an episode's first one it was constant. So a perfect servo, which holds each
action for a step, is late by about half a step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from simtune.checking.servos.roughness import roughness

_LONGEST_LAG_S = 0.6
_FEWEST_LAG_STEPS = 4.0  # tried, however long a step is
_NUM_DELAYS = 25  # tried first
_REFINEMENT, _NUM_REFINEMENTS = 5, 4  # each time with a fifth of the spacing
_NUM_TIME_CONSTANTS = 10  # of a first-order lag, tried first
_TRAVEL_PERCENTILES = (1, 99)  # a lost packet is no motion

Episodes = Sequence[np.ndarray]


@dataclass(frozen=True, kw_only=True)
class ServoResponse:
    """One joint's servo; all lengths in its sensor's unit."""

    lag_s: float  # the constant delay with the least residuals
    lag_steps: float
    offset: float  # measured − command, delayed
    rms: float  # residuals with delay and offset
    time_constant_s: float  # of a first-order lag, with its own delay and offset
    filtered_lag_s: float
    filtered_offset: float
    filtered_rms: float  # residuals with these
    noise: float  # of the readings, standard deviation; NaN if they never change
    travel: float  # how far the joint moves
    commanded: float  # how far its command moves


def fit_servo(commands: Episodes, measured: Episodes, step_s: float) -> ServoResponse:
    """Fit a joint's (T,) commands and (T + 1,) readings in each episode; NaN is no reading.

    NaN for what its command cannot tell, such as the delay of a constant one.
    """
    moved, commanded = usual_travel(measured), usual_travel(commands)
    noise = roughness(measured)
    if not commanded > 0 or not np.isfinite(moved):
        unknown = dict.fromkeys(ServoResponse.__annotations__, np.nan)
        known = {"noise": noise, "travel": moved, "commanded": commanded}
        return ServoResponse(**(unknown | known))
    lag = delay_of(commands, measured, step_s)
    offset, rms = _offset_and_rms(commands, measured, lag)
    time_constant, its_lag = _first_order(commands, measured, _longest_lag(step_s))
    filtered = [filtered_by(c, time_constant) for c in commands]
    its_offset, its_rms = _offset_and_rms(filtered, measured, its_lag)
    return ServoResponse(
        lag_s=lag * step_s,
        lag_steps=lag,
        offset=offset,
        rms=rms,
        time_constant_s=time_constant * step_s,
        filtered_lag_s=its_lag * step_s,
        filtered_offset=its_offset,
        filtered_rms=its_rms,
        noise=noise,
        travel=moved,
        commanded=commanded,
    )


def delay_of(commands: Episodes, measured: Episodes, step_s: float) -> float:
    """The constant delay in steps that leaves least of the readings."""

    def left(lag: float) -> float:
        return _offset_and_rms(commands, measured, lag)[1]

    return lowest(left, _longest_lag(step_s))


def predict(servo: ServoResponse, commands: Episodes, step_s: float) -> list[np.ndarray]:
    """(T,) readings that the first-order lag, its delay and its offset predict."""
    filtered = (filtered_by(c, servo.time_constant_s / step_s) for c in commands)
    late = servo.filtered_lag_s / step_s
    return [delayed_by(c, late) + servo.filtered_offset for c in filtered]


def delayed_by(command: np.ndarray, steps: float) -> np.ndarray:
    """(T,) command, delayed by `steps` steps; before, the first value."""
    times = np.arange(len(command))
    return np.interp(times - steps, times, command)


def filtered_by(command: np.ndarray, steps: float) -> np.ndarray:
    """(T,) command, filtered by a first-order lag of `steps` steps; 0: unchanged.

    Exact for a piecewise linear command that was constant before.
    """
    if steps < 1e-3:
        return command
    stays = np.exp(-1 / steps)
    now, before = 1 - steps * (1 - stays), steps * (1 - stays) - stays
    first = np.array([(before + stays) * command[0]])
    return lfilter([now, before], [1, -stays], command, zi=first)[0]


def _longest_lag(step_s: float) -> float:
    return max(_FEWEST_LAG_STEPS, _LONGEST_LAG_S / step_s)


def _offset_and_rms(commands: Episodes, measured: Episodes, lag: float) -> tuple[float, float]:
    pairs = zip(commands, measured, strict=True)
    away = np.concatenate([read[: len(c)] - delayed_by(c, lag) for c, read in pairs])
    return float(np.nanmean(away)), float(np.nanstd(away))


def _first_order(commands: Episodes, measured: Episodes, longest: float) -> tuple[float, float]:
    """Time constant and delay, in steps, with the least residuals."""

    def with_constant(steps: float) -> tuple[float, float]:
        filtered = [filtered_by(c, steps) for c in commands]

        def left(lag: float) -> float:
            return _offset_and_rms(filtered, measured, lag)[1]

        lag = lowest(left, longest, num=_NUM_DELAYS // 2, times=_NUM_REFINEMENTS - 1)
        return left(lag), lag

    constant = lowest(lambda s: with_constant(s)[0], longest, num=_NUM_TIME_CONSTANTS, times=2)
    return constant, with_constant(constant)[1]


def lowest(
    cost: Callable[[float], float],
    most: float,
    *,
    num: int = _NUM_DELAYS,
    times: int = _NUM_REFINEMENTS,
    finer: int = _REFINEMENT,
    is_bound: bool = True,
) -> float:
    """Minimum of the cost on a grid from 0 to `most`, then `times` on `finer` ones around it.

    Unless `most` is a bound, somewhat beyond it, too.
    """
    grid = np.linspace(0, most, num)
    spacing = grid[1]
    for _ in range(times):
        best = grid[int(np.argmin([cost(float(x)) for x in grid]))]
        spacing /= finer
        around = best + spacing * np.arange(-finer + 1, finer)
        grid = around[(around >= 0) & (around <= (most if is_bound else np.inf))]
    return float(grid[int(np.argmin([cost(float(x)) for x in grid]))])


def usual_travel(episodes: Episodes) -> float:
    """How far values go, but for a hundredth to either side; NaN if there are none."""
    values = np.concatenate(list(episodes))
    if not np.isfinite(values).any():
        return float("nan")
    return float(np.ptp(np.nanpercentile(values, _TRAVEL_PERCENTILES)))
