"""From a rough estimate to a fine one: track, guess states, fit the physics, fit the pictures."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simtune.fit.estimator import StateEstimator
from simtune.fit.particles import ParticleConfig, Particles
from simtune.fit.physics import Physics
from simtune.fit.pictures import PictureFit, align_to_images, fit_pictures
from simtune.fit.result import FitResult, Misfit
from simtune.fit.shooting import Shooting, ShootingConfig, ShootingFit, Stage
from simtune.fit.tracks import Tracks, noise_px, to_tracks, track
from simtune.progress import Progress
from simtune.search_param_model.simulated import SimulatedWorlds
from simtune.simulation import Simulator
from simtune.vision.detector import Detections, KeypointDetector
from simtune.vision.keypoints import Keypoints

_NUM_PICTURES = 40
_SMALLEST_STD = 1.5e-3  # in unit coordinates: pictures have but 256 levels, fits end sometime
_FEWEST_TO_FIT = 2  # episodes
_UNSEEN_PX = 0.2
_SIDESTEP = (0.01, 0.1)  # at least, at most, from a start, in unit coordinates
_SPREAD = (0.02, 0.1)  # of particles: at least, at most, in unit coordinates
_PRIOR_SPREADS = 3.0  # as far as a first guess may be off, in terms of its usual error
_CLEARLY_BETTER = 0.05  # by so much a delay has to lower −log likelihood to be believed


def num_fitted(num_episodes: int) -> int:
    """All but the last, which is kept to test the fit on, where that leaves two or more."""
    return num_episodes - (num_episodes > _FEWEST_TO_FIT)


class ReplayFit:
    """Fits one simulator to episodes, given the detector and worlds to learn from."""

    def __init__(
        self,
        simulator: Simulator,
        keypoints: Keypoints,
        detector: KeypointDetector,
        seed: int,
        particles: ParticleConfig | None = None,
        shooting: ShootingConfig | None = None,
    ):
        self._simulator, self._keypoints, self._detector = simulator, keypoints, detector
        appearance = simulator.space.is_appearance
        self._moving, self._appearance = np.flatnonzero(~appearance), np.flatnonzero(appearance)
        self._seed = seed
        self._particles = particles or ParticleConfig()
        self._config = shooting or ShootingConfig()

    def learn(self, worlds: SimulatedWorlds, seen: Detections, progress: Progress) -> float:
        """From filmed worlds that the detector was not taught on: its noise, and to guess states.

        `seen`: what the detector made of their frames.
        """
        at = worlds.filmed_from[:, None] + np.arange(worlds.frames.shape[1] - 1)
        actions = worlds.actions[np.arange(len(at))[:, None], 0, at]
        tracks = to_tracks(seen, actions)
        self._noise_px = noise_px(tracks, worlds.filmed_keypoints())
        self._physics = Physics(self._simulator, self._keypoints, worlds.states[0, 0])
        self._estimator = StateEstimator(
            self._physics.space,
            len(self._keypoints),
            self._simulator.action_scale,
            self._simulator.image_size / 8,
            self._seed,
        )
        return self._estimator.train(tracks, self._physics.states(worlds.states), progress)

    def fit(
        self,
        frames: Sequence[np.ndarray],
        actions: np.ndarray,
        start: np.ndarray,
        start_std: np.ndarray,
        lag: int | None = 0,
        grow: bool = True,
    ) -> FitResult:
        """Fit E times (T + 1, H, W, 3) frames and (E, T, A) actions, from (N,) parameters.

        `start_std`: (N,) of the start in unit coordinates. With three episodes or more the last
        one is kept to test the fit on. `lag` is the actions' delay in steps; None: find it.
        `grow`: windows where short ones do not tell enough, which takes time.
        """
        tracks = track(self._detector, frames, actions)
        if lag is None:
            lag = self._find_lag(tracks, start)
        tracks = tracks.delayed(lag)
        num, kept = len(tracks.actions), num_fitted(len(tracks.actions))
        fitted, held_out = slice(0, kept), slice(kept if kept < num else 0, num)
        space = self._simulator.space
        states, start, start_std = self._follow(tracks, fitted, start, start_std)
        motion, apart = self._fit_motion(
            tracks.episodes(fitted), states[fitted], start, start_std, grow
        )
        unit = space.to_unit(start)
        unit[self._moving] = motion.unit
        pictures = self._fit_pictures(motion, frames, space.from_unit(unit))
        unit[self._appearance] = pictures.unit
        test = self._shooting(self._moving[:0]).fit(
            tracks.episodes(held_out), states[held_out], space.from_unit(unit)
        )
        deviation = np.sqrt(np.diag(motion.covariance))
        std = np.zeros(len(space))
        std[self._moving] = np.hypot(deviation, apart)
        std[self._appearance] = np.sqrt(np.diag(pictures.covariance))
        return FitResult(
            space.from_unit(unit),
            np.maximum(std, _SMALLEST_STD),
            motion.covariance / np.outer(deviation, deviation),
            self._moving,
            Misfit(test.residual_px, pictures.noise),
            motion.rows[0, 0],
            lag,
        )

    def _shooting(self, fitted: np.ndarray, config: ShootingConfig | None = None) -> Shooting:
        return Shooting(
            self._physics,
            self._noise_px,
            self._estimator.spread,
            fitted,
            config or self._config,
        )

    def _follow(
        self, tracks: Tracks, fitted: slice, start: np.ndarray, start_std: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States of all episodes; parameters, and their std in unit coordinates, of `fitted`."""
        particles = Particles(
            self._physics,
            self._noise_px,
            self._estimator.spread,
            self._moving,
            self._particles,
        )
        unit, std = self._simulator.space.to_unit(start), start_std.copy()
        guessed = self._estimator(tracks)
        followed = particles.follow(tracks, guessed, unit, np.clip(start_std, *_SPREAD))
        each = followed.unit[fitted]
        unit[self._moving] = np.median(each, 0)
        if len(each) > 1:  # of one episode nobody knows how others differ
            std[self._moving] = each.std(0, ddof=1) / np.sqrt(len(each))
        return followed.states, self._simulator.space.from_unit(unit), std

    def _fit_motion(
        self,
        tracks: Tracks,
        states: np.ndarray,
        start: np.ndarray,
        start_std: np.ndarray,
        grow: bool,
    ) -> tuple[ShootingFit, np.ndarray]:
        """From below and from above: the middle, and (P,) how far apart the two end.

        Unless windows grow from the better one: those have the last word.
        """
        space, shooting = self._simulator.space, self._shooting(self._moving)
        unit, fits = space.to_unit(start), []
        for side in (-1, 1):
            begin = space.from_unit(unit + side * np.clip(start_std, *_SIDESTEP))
            fits.append(shooting.fit(tracks, states, begin))
        better = min(fits, key=lambda fit: float(np.median(fit.misfit)))
        grown = shooting.grow(tracks, states, start, better) if grow else better
        if grown is not better:
            return grown, np.zeros(len(self._moving))
        one, other = (fit.unit for fit in fits)
        return replace(better, unit=(one + other) / 2), np.abs(one - other) / 2

    def _find_lag(self, tracks: Tracks, start: np.ndarray) -> int:
        """The delay of the actions, of 0 to 2 steps, with which the motion fits best."""
        stages = (Stage(4, 3, 3.0), Stage(8, 3))
        num_windows = max(12, self._config.num_windows // 3)
        quick = ShootingConfig(stages=stages, num_windows=num_windows)
        misfits = []
        for lag in range(3):
            late = tracks.delayed(lag)
            fit = self._shooting(self._moving, quick).fit(late, self._estimator(late), start)
            misfits.append(float(np.median(fit.misfit)))
        best = int(np.argmin(misfits))
        return best if misfits[best] < misfits[0] - _CLEARLY_BETTER else 0

    def _fit_pictures(
        self, motion: ShootingFit, frames: Sequence[np.ndarray], parameters: np.ndarray
    ) -> PictureFit:
        """Pictures of the windows that fit well, spread over all of them."""
        good = np.flatnonzero(motion.misfit <= np.quantile(motion.misfit, 0.6))
        length = motion.rows.shape[1] - 1
        # Not from the windows' ends, where less is known of the states.
        within = np.arange(-(-length // 4), length - length // 4 + 1)
        spread = np.linspace(0, len(good) * len(within) - 1, _NUM_PICTURES)
        at = np.unique(spread.round().astype(int))
        chosen, middle = good[at // len(within)], within[at % len(within)]
        places = zip(motion.episode[chosen], motion.step[chosen] + middle, strict=True)
        shown = np.stack([frames[episode][step] for episode, step in places])
        rows = motion.rows[chosen, middle]
        for tangent in self._unseen_by_keypoints():
            rows = align_to_images(
                self._simulator, shown, rows, parameters, self._physics.space, tangent
            )
        return fit_pictures(self._simulator, shown, rows, parameters, self._appearance)

    def _unseen_by_keypoints(self) -> np.ndarray:
        """(D, 2 nv) changes of position, as large as is unknown, that move no keypoint.

        A camera that follows the robot, say: how far it went shows in the ground's texture only.
        """
        space = self._physics.space
        changes = np.diag(_PRIOR_SPREADS * self._estimator.spread)[: space.nv]
        moved = space.move(self._physics.some_state, np.vstack([0 * changes[:1], changes]))
        nominal = self._physics.parameters.to_unit(self._physics.parameters.nominal)
        units = np.repeat(nominal[None], len(moved), 0)
        still = np.zeros((len(moved), 1, self._simulator.num_actions))
        _, seen = self._physics.play(moved, units, still)
        return changes[np.abs(seen[1:, 0] - seen[:1, 0]).max((1, 2), initial=0) < _UNSEEN_PX]
