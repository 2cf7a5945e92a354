"""From a rough estimate to a fine one: track, guess states, fit the physics, fit the pictures.

How far the result can be trusted is measured, not assumed: replicas, simulated worlds near the
estimate, are filmed and fitted in just the same way, and say how large errors are in terms of
what a fit thinks of itself, and how well videos fit that the simulator did make.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtr, ndtri

from simtune.fit.estimator import StateEstimator
from simtune.fit.pictures import PictureFit, aligned, fit_pictures
from simtune.fit.shooting import Shooting, ShootingConfig, ShootingFit, Stage
from simtune.fit.states import StateSpace
from simtune.fit.tracks import Tracks, track
from simtune.progress import Progress
from simtune.search_param_model.landmarks import Landmarks
from simtune.search_param_model.sight import Sight
from simtune.search_param_model.simulated import Camera, SimulatedWorlds
from simtune.simulation import Simulator

_NUM_PICTURES = 40
_SURE = 0.8
_SMALLEST_STD = 1.5e-3  # in unit coordinates: pictures have but 256 levels, fits end sometime
_FEWEST_TO_FIT = 2  # episodes
_UNSEEN_PX = 0.2
_PRIOR_SPREADS = 3.0  # as far as a first guess may be off, in terms of its usual error
_UNKNOWN_INFLATION = 3.0  # of standard deviations, where there are no replicas
_POOLED_COUNT = 3.0  # a group of parameters counts like so many replicas of each one
_USUAL = 0.85  # share of errors that are taken to be no accident


@dataclass(frozen=True)
class Misfit:
    """How badly videos fit a simulator; larger is worse."""

    motion: float  # −log likelihood of a landmark's place, median over windows held out
    motion_px: float  # distance between where sight is sure a landmark is and where it should be
    picture: float  # noise of a pixel, of the full scale
    outline: float  # share of pixels that are far off


@dataclass(frozen=True)
class Fit:
    """Parameters (N,) as fitted, with their standard deviations in unit coordinates."""

    parameters: np.ndarray
    std: np.ndarray  # (N,)
    correlation: np.ndarray  # (P, P) between the fitted parameters that are no mere appearance
    moving: np.ndarray  # (P,) which those are
    misfit: Misfit
    lag: int  # steps by which the actions seem to come late


def num_fitted(num_episodes: int) -> int:
    """All but the last, which is kept to test the fit on, where that leaves two or more."""
    return num_episodes - (num_episodes > _FEWEST_TO_FIT)


class ReplayFit:
    """Fits one simulator to episodes, given a sight and worlds to learn from."""

    def __init__(
        self,
        simulator: Simulator,
        landmarks: Landmarks,
        sight: Sight,
        seed: int,
        config: ShootingConfig | None = None,
    ):
        self._simulator, self._landmarks, self._sight = simulator, landmarks, sight
        self._space = StateSpace(simulator.model)
        appearance = np.array([p.is_appearance for p in simulator.space])
        self._moving, self._appearance = np.flatnonzero(~appearance), np.flatnonzero(appearance)
        self._seed = seed
        self._config = config or ShootingConfig()

    def learn(self, worlds: SimulatedWorlds, progress: Progress) -> float:
        """From filmed worlds that sight was not taught on: its noise, and to guess states."""
        at = worlds.filmed_from[:, None] + np.arange(worlds.frames.shape[1] - 1)
        actions = worlds.actions[np.arange(len(at))[:, None], 0, at]
        tracks = track(self._sight, worlds.frames, actions)
        errors = tracks.places - worlds.filmed_landmarks()[:, :, None]
        self._noise_px = _noise(errors, tracks.probability.sum(2))
        self._row = worlds.states[0, 0]
        self._estimator = StateEstimator(
            self._space,
            len(self._landmarks),
            self._simulator.action_scale,
            self._simulator.image_size / 8,
            self._seed,
        )
        states = worlds.states[..., 1 : 1 + self._space.nq + self._space.nv]
        return self._estimator.train(tracks, states, progress)

    def fit(
        self,
        frames: np.ndarray,
        actions: np.ndarray,
        start: np.ndarray,
        start_std: np.ndarray,
        lag: int | None = 0,
    ) -> Fit:
        """Fit (E, T + 1, H, W, 3) frames and (E, T, A) actions, from (N,) parameters.

        `start_std`: (N,) of the start in unit coordinates. With three episodes or more the last
        one is kept to test the fit on. `lag` is the actions' delay in steps; None: find it.
        """
        tracks = track(self._sight, frames, actions)
        if lag is None:
            lag = self._find_lag(tracks, start)
        tracks = tracks.delayed(lag)
        states = self._estimator(tracks)
        num, kept = len(tracks.actions), num_fitted(len(tracks.actions))
        fitted, held_out = slice(0, kept), slice(kept if kept < num else 0, num)
        space = self._simulator.space
        motion = self._fit_motion(tracks.episodes(fitted), states[fitted], start, start_std)
        unit = space.to_unit(start)
        unit[self._moving] = motion.unit
        pictures = self._fit_pictures(motion, frames, space.from_unit(unit))
        unit[self._appearance] = pictures.unit
        test = self._shooting(self._moving[:0]).fit(
            tracks.episodes(held_out), states[held_out], space.from_unit(unit)
        )
        std = np.zeros(len(space))
        std[self._moving] = np.sqrt(np.diag(motion.covariance))
        std[self._appearance] = np.sqrt(np.diag(pictures.covariance))
        deviation = np.sqrt(np.diag(motion.covariance))
        return Fit(
            space.from_unit(unit),
            np.maximum(std, _SMALLEST_STD),
            motion.covariance / np.outer(deviation, deviation),
            self._moving,
            Misfit(
                float(np.median(test.misfit)),
                test.residual_px,
                pictures.noise,
                pictures.unexplained,
            ),
            lag,
        )

    def replicas(
        self,
        fit: Fit,
        actions: np.ndarray,
        num: int,
        guess_std: np.ndarray,
        camera: Camera | None,
        rng: np.random.Generator,
    ) -> "Replicas":
        """Fit `num` worlds near `fit`, which play (E, T, A) actions, as the real one was fitted.

        `guess_std`: (N,) in unit coordinates, of the guess that the real one's fit started from.
        """
        space, simulator = self._simulator.space, self._simulator
        unit = space.to_unit(fit.parameters)
        errors, misfits = [], []
        for _ in range(num):
            spread = np.maximum(2 * fit.std, 0.01)
            truth = np.clip(unit + spread * rng.normal(size=len(unit)), 0.002, 0.998)
            worlds = np.repeat(space.from_unit(truth)[None], len(actions), 0)
            played = Tracks(np.empty(0), np.empty(0), actions).delayed(fit.lag).actions
            rollouts = simulator.roll_out(worlds, played, rng)
            if len(rollouts) < len(actions):
                continue
            frames = simulator.film(rollouts)
            if camera is not None:
                frames = camera.film(frames, rng)
            guess = space.from_unit(truth + guess_std * rng.normal(size=len(unit)))
            found = self.fit(frames, actions, guess, guess_std, fit.lag)
            errors.append((space.to_unit(found.parameters) - truth) / found.std)
            misfits.append(found.misfit)
        groups = np.isin(np.arange(len(unit)), self._appearance)
        return Replicas(np.array(errors).reshape(-1, len(unit)), groups, misfits)

    def _shooting(self, fitted: np.ndarray, config: ShootingConfig | None = None) -> Shooting:
        return Shooting(
            self._simulator,
            self._landmarks,
            self._noise_px,
            self._estimator.spread,
            fitted,
            self._row,
            config or self._config,
        )

    def _fit_motion(
        self, tracks: Tracks, states: np.ndarray, start: np.ndarray, start_std: np.ndarray
    ) -> ShootingFit:
        """From below and from above; what they disagree by is part of what is not known."""
        space, shooting = self._simulator.space, self._shooting(self._moving)
        unit, fits = space.to_unit(start), []
        for side in (-1, 1):
            begin = space.from_unit(unit + side * np.clip(start_std, 0.01, 0.1))
            fits.append(shooting.fit(tracks, states, begin))
        better = min(fits, key=lambda fit: float(np.median(fit.misfit)))
        apart = (fits[1].unit - fits[0].unit) / 2
        covariance = better.covariance + np.outer(apart, apart)
        middle = (fits[0].unit + fits[1].unit) / 2
        return replace(better, unit=middle, covariance=covariance)

    def _find_lag(self, tracks: Tracks, start: np.ndarray) -> int:
        """The delay of the actions, of 0 to 2 steps, with which the motion fits best."""
        stages = (Stage(4, 3, 3.0), Stage(8, 3))
        quick = ShootingConfig(stages=stages, num_windows=max(12, self._config.num_windows // 3))
        misfits = []
        for lag in range(3):
            late = tracks.delayed(lag)
            fit = self._shooting(self._moving, quick).fit(late, self._estimator(late), start)
            misfits.append(float(np.median(fit.misfit)))
        return int(np.argmin(misfits))

    def _fit_pictures(
        self, motion: ShootingFit, frames: np.ndarray, parameters: np.ndarray
    ) -> PictureFit:
        """Pictures in the middle of the windows that fit well, spread over all of them."""
        middle = motion.rows.shape[1] // 2
        good = np.flatnonzero(motion.misfit <= np.quantile(motion.misfit, 0.6))
        chosen = good[np.linspace(0, len(good) - 1, min(_NUM_PICTURES, len(good))).astype(int)]
        shown = frames[motion.episode[chosen], motion.step[chosen] + middle]
        rows = motion.rows[chosen, middle]
        for tangent in self._unseen_by_landmarks():
            rows = aligned(self._simulator, shown, rows, parameters, self._space, tangent)
        return fit_pictures(self._simulator, shown, rows, parameters, self._appearance)

    def _unseen_by_landmarks(self) -> np.ndarray:
        """(D, 2 nv) changes of position, as large as is unknown, that move no landmark.

        A camera that follows the robot, say: how far it went shows in the ground's texture only.
        """
        space, num = self._space, self._space.nv
        changes = np.diag(_PRIOR_SPREADS * self._estimator.spread)[:num]
        state = self._row[1 : 1 + space.nq + space.nv]
        rows = np.repeat(self._row[None], 1 + num, 0)
        rows[1:, 1 : 1 + len(state)] = space.move(state, changes)
        parameters = np.repeat(self._simulator.space.nominal[None], 1 + num, 0)
        still = np.zeros((1 + num, 1, self._simulator.num_actions))
        rng = np.random.default_rng(0)  # starts are given: nothing is drawn
        seen = self._simulator.roll_out(
            parameters, still, rng, self._landmarks.record, rows, keep_diverged=True
        ).recorded
        assert seen is not None, "asked for above"
        return changes[np.abs(seen[1:, 0] - seen[:1, 0]).max(-1) < _UNSEEN_PX]


@dataclass(frozen=True)
class Replicas:
    """What fits of known worlds showed."""

    errors: np.ndarray  # (K, N) in terms of each fit's own standard deviations
    groups: np.ndarray  # (N,) parameters of the same number are about as hard to find
    misfits: list[Misfit] = field(default_factory=list)

    def inflation(self) -> np.ndarray:
        """(N,) by how much standard deviations have to be multiplied; at least 1."""
        return _inflation(self.errors, self.groups)

    def ranks(self) -> np.ndarray:
        """(K, N) probability, by each replica's fit, of being below its truth: uniform if right.

        Each is judged by an inflation that the others alone say.
        """
        others = [np.delete(self.errors, i, axis=0) for i in range(len(self.errors))]
        factors = np.array([_inflation(o, self.groups) for o in others])
        return ndtr(-self.errors / factors.reshape(self.errors.shape))

    def ratio(self, misfit: Misfit, name: str) -> float:
        """A misfit over the largest of the replicas'."""
        largest = max((getattr(m, name) for m in self.misfits), default=np.inf)
        return getattr(misfit, name) / max(largest, 1e-9)


def _inflation(errors: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """(N,) for (K, N) errors in terms of their standard deviations.

    Few replicas say little of a single parameter: it leans on all of its group, (N,).
    """
    factors = np.full(len(groups), _UNKNOWN_INFLATION)
    if not len(errors):
        return factors
    for group in np.unique(groups):
        its = np.abs(errors[:, groups == group])  # (K, G)
        # A single replica that went astray is no reason to widen everything.
        pooled = max(1.0, float(np.quantile(its, _USUAL)) / ndtri((1 + _USUAL) / 2))
        square = np.square(np.minimum(its, 3 * pooled)).sum(0) + _POOLED_COUNT * pooled**2
        factors[groups == group] = np.sqrt(np.maximum(1, square / (len(its) + _POOLED_COUNT)))
    return factors


def _noise(errors: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """(L,) pixels: robust standard deviation of (W, F, 2, L, 2) errors, where sight is sure.

    Of the better place: that it may be the other one is no noise.
    """
    better = np.square(errors).sum(-1).argmin(2)[:, :, None, :, None]
    errors = np.abs(np.take_along_axis(errors, better, 2)[:, :, 0])  # (W, F, L, 2)
    noise = []
    for landmark in range(errors.shape[2]):
        known = probability[..., landmark]
        sure = known >= min(_SURE, float(np.median(known)))
        noise.append(1.48 * np.median(errors[:, :, landmark][sure]) + 0.05)
    return np.array(noise)
