"""Replicas: how far a fit can be trusted is measured, not assumed.

Simulated worlds near the estimate are filmed and fitted in just the same way as the real one. They
say how large errors are in terms of what a fit thinks of itself, and how well videos fit that the
simulator did make.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr, ndtri, stdtrit

from simtune.fit.replay_fit import ReplayFit
from simtune.fit.result import FitResult, Misfit
from simtune.simulation import Simulator
from simtune.trajectory import delayed
from simtune.vision.image_noise import ImageNoise

_UNKNOWN_INFLATION = 3.0  # of standard deviations, where there are no replicas
_POOLED_COUNT = 3.0  # all of a kind count like so many replicas of each parameter
_USUAL = 0.85  # share of errors that are taken to be no accident
# A fit may be too careful, but few replicas may all be lucky: worlds drawn at random show that what
# moves must not be believed to be better known than it says (docs/results.md).
_LEAST_INFLATION = {"moving": 1.0, "appearance": 0.7}
_SMALLEST_SPREAD = 0.01  # of replicas around the estimate, in unit coordinates
_FEW_EPISODES = 3  # are enough to compare errors with what a fit thinks of itself
# A replica that fits so many times worse went astray where the real world's fit did not.
_ASTRAY = 1.5
_MARGIN = 0.002  # truths keep so far from the bounds


@dataclass(frozen=True)
class Bootstrap:
    """What fits of known worlds showed."""

    errors: np.ndarray  # (K, N) in terms of each fit's own standard deviations
    is_moving: np.ndarray  # (N,) bool: the others are appearance, which is easier to find
    misfits: list[Misfit] = field(default_factory=list)  # also of fits whose errors say nothing

    def inflation(self) -> np.ndarray:
        """(N,) by how much standard deviations have to be multiplied."""
        return _inflation(self.errors, self.is_moving)

    def ranks(self) -> np.ndarray:
        """(K, N) probability, by each replica's fit, of being below its truth: uniform if right.

        Each is judged by an inflation that the others alone say.
        """
        others = [np.delete(self.errors, i, axis=0) for i in range(len(self.errors))]
        factors = np.array([_inflation(o, self.is_moving) for o in others])
        return ndtr(-self.errors / factors.reshape(self.errors.shape))

    def ratio(self, misfit: Misfit, name: str) -> float:
        """A misfit over the largest of the replicas'; one that cannot be told (NaN) is infinite.

        Unless that of every replica is likewise, or there are none: then nothing can be compared.
        """
        known = [value for m in self.misfits if not np.isnan(value := getattr(m, name))]
        if not known:
            return 0.0
        value = getattr(misfit, name)
        return float("inf") if np.isnan(value) else value / max(*known, 1e-9)


def _inflation(errors: np.ndarray, is_moving: np.ndarray) -> np.ndarray:
    """(N,) for (K, N) errors in terms of their standard deviations.

    Few replicas say little of a single parameter: it leans on all of its kind. What they say is
    not sure itself, so 90 % intervals are as wide as Student's.
    """
    factors = np.full(len(is_moving), _UNKNOWN_INFLATION)
    if not len(errors):
        return factors
    for kind, of_kind in (("moving", is_moving), ("appearance", ~is_moving)):
        if not of_kind.any():
            continue
        its, least = np.abs(errors[:, of_kind]), _LEAST_INFLATION[kind]  # (K, G)
        # A single replica that went astray is no reason to widen everything.
        usual = float(np.quantile(its, _USUAL)) / ndtri((1 + _USUAL) / 2)
        pooled = max(least, usual)
        square = np.square(np.minimum(its, 3 * pooled)).sum(0) + _POOLED_COUNT * pooled**2
        count = len(its) + _POOLED_COUNT
        unsure = stdtrit(count, 0.95) / ndtri(0.95)
        factors[of_kind] = unsure * np.sqrt(square / count).clip(least)
    return factors


def run_bootstrap(
    replay: ReplayFit,
    simulator: Simulator,
    fit: FitResult,
    actions: np.ndarray,
    num: int,
    guess: np.ndarray,
    guess_std: np.ndarray,
    image_noise: ImageNoise | None,
    rng: np.random.Generator,
    grow: bool = True,
) -> Bootstrap:
    """Fit `num` worlds near `fit`, which play (E, T, A) actions, as the real one was fitted.

    `guess`: (N,) what the real one's fit started from; `guess_std`: (N,) in unit coordinates.
    `image_noise`: what a camera adds, where the real world does not look like the simulator. `grow`: see
    `ReplayFit.fit`.
    """
    space, actions = simulator.space, actions[:_FEW_EPISODES]
    unit = space.to_unit(fit.parameters)
    # Not farther away than was known before: what the fit leaves open may fill the whole space.
    spread = np.clip(2 * fit.std, _SMALLEST_SPREAD, np.maximum(guess_std, _SMALLEST_SPREAD))
    # As far as the real one's fit had to go: what begins near the truth ends there easily.
    away = np.maximum(guess_std, np.abs(unit - space.to_unit(guess)))
    errors, misfits, astray = [], [], []
    for _ in range(num):
        truth = np.clip(unit + spread * rng.normal(size=len(unit)), _MARGIN, 1 - _MARGIN)
        worlds = np.repeat(space.from_unit(truth)[None], len(actions), 0)
        rollouts = simulator.roll_out(worlds, delayed(actions, fit.lag), rng)
        if len(rollouts) < len(actions):
            continue  # its physics diverged
        frames = simulator.film(rollouts)
        if image_noise is not None:
            one_world = frames.reshape(1, -1, *frames.shape[2:])  # one camera films all of it
            image_noise.apply(one_world, rng)
            frames = one_world.reshape(frames.shape)
        begin = space.from_unit(truth + away * rng.normal(size=len(unit)))
        found = replay.fit(list(frames), actions, begin, guess_std, fit.lag, grow)
        misfits.append(found.misfit)
        claimed = np.hypot(found.std, found.discrepancy(looks_alike=image_noise is None))
        errors.append((space.to_unit(found.parameters) - truth) / claimed)
        # Either may be NaN.
        astray.append(found.misfit.motion_px > _ASTRAY * fit.misfit.motion_px)
    # Where all of them went astray, the real one may well have: then they do count.
    kept = ~np.array(astray, bool) | np.all(astray)
    return Bootstrap(np.array(errors).reshape(-1, len(unit))[kept], fit.is_moving, misfits)
