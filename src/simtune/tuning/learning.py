"""What a round learns in simulation: the detector, and the posterior network of survival curves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch

from simtune.budget import Budget
from simtune.fit import PointEstimate, Split
from simtune.networks.training import TrainingClock
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.search_param_model.simulated import FilmedWorlds, NearlyAllDiverged, SimulatedWorlds
from simtune.search_param_model.training_pictures import TrainingPictures
from simtune.trajectory import Trajectory
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.rounds import SIMULATE, TRAIN_DETECTOR, TRAIN_POSTERIOR_NET
from simtune.tuning.survival_curves import candidate_grid
from simtune.tuning.world_sampler import WorldSampler
from simtune.vision.detections import Detections
from simtune.vision.detector_noise import DetectorNoise

_NEAR_STDS = 2.5  # from a start, within which worlds resemble the real one


class HeldOut(NamedTuple):
    """Worlds that the detector was not trained on, and its detections there."""

    worlds: FilmedWorlds
    detections: Detections

    @property
    def episodes(self) -> list[Detections]:
        """The detections in each world."""
        return self.detections.episodes(len(self.worlds.frames))

    def noise(self) -> DetectorNoise:
        """The detector's, in these worlds."""
        return DetectorNoise.measured(self.episodes, self.worlds.filmed_keypoints())


class Detected(NamedTuple):
    """Trajectories, and the detections in the frames of each."""

    trajectories: list[Trajectory]
    detections: Sequence[Detections]


class LearningResult(NamedTuple):
    """What a round's networks say, before anything is fitted."""

    searched: Distribution  # the range of the simulated worlds
    keypoints: np.ndarray  # (W, E, T + 1, L, 2) px, true ones of these worlds
    held_out: HeldOut
    detected: Detected  # in the real trajectories
    prob_higher: np.ndarray  # (N, C) survival curves of the posterior network


@dataclass(frozen=True, kw_only=True)
class Learning:
    """The networks of a search, and the worlds they learn from."""

    model: PosteriorSearchParamModel
    worlds: WorldSampler
    config: PosteriorSearchConfig
    is_fitted: bool  # whether a fit follows, which decides the estimate

    def simulate(
        self, real: list[Trajectory], searched: Distribution, budget: Budget
    ) -> tuple[SimulatedWorlds, TrainingPictures]:
        """Worlds in the range, which replay the real actions, and pictures of them."""
        config = self.config
        budget.report("simulating and filming")
        return self.worlds.play_and_draw(
            real,
            searched,
            config.num_worlds,
            self._episodes_per_world(real),
            config.pictures_per_world,
            budget.share(config.collect_share, SIMULATE),
        )

    def train_detector(
        self, pictures: TrainingPictures, searched: Distribution, number: int, budget: Budget
    ) -> dict[str, float]:
        """In round `number`, counted from 0."""
        config = self.config
        updates = config.detector_updates[min(number, len(config.detector_updates) - 1)]
        part = budget.share(config.detector_share, TRAIN_DETECTOR)
        clock = TrainingClock(updates, part, "training the detector", config.least_updates)
        return {"loss/detector": self.model.train_detector(pictures, searched, clock)}

    def hold_out(self, real: list[Trajectory], searched: Distribution, budget: Budget) -> HeldOut:
        """Other worlds, to measure the detector's errors."""
        config = self.config
        part = budget.share(config.collect_share / 2)
        worlds = self.worlds.film(
            real, searched, config.held_out_worlds, config.held_out_steps, part
        )
        return HeldOut(worlds, self.model.detect(worlds.frames))

    def film_near(self, learned: LearningResult, start: PointEstimate, budget: Budget) -> HeldOut:
        """Worlds that resemble the real one, as far as `start` tells; others if those diverge.

        A detector's errors depend on colours and light: in all pictures of one peg, two pixels
        large, it was half a pixel too far to the right and too high, and a rope came out 10 % too
        short.
        """
        real, searched = learned.detected.trajectories, learned.searched
        space, unit = searched.space, searched.space.to_unit(start.parameters)
        learnt = space.to_unit(searched.low), space.to_unit(searched.high)  # by the detector
        ends = (np.clip(unit + side * _NEAR_STDS * start.std, *learnt) for side in (-1, 1))
        near = searched.with_interval(start.parameters, *map(space.from_unit, ends))
        config = self.config
        try:
            worlds = self.worlds.film(real, near, config.near_worlds, config.near_steps, budget)
        except NearlyAllDiverged:
            return learned.held_out
        return HeldOut(worlds, self.model.detect(worlds.frames))

    def train_posterior_net(
        self,
        real: list[Trajectory],
        worlds: SimulatedWorlds,
        held_out: HeldOut,
        searched: Distribution,
        budget: Budget,
    ) -> dict[str, float]:
        """Without a fit to follow, the network learns from more worlds, and for longer."""
        config, errors = self.config, self.model.detector_errors(*held_out, searched)
        scale = 1 if self.is_fitted else config.no_fit_scale
        if scale > 1:
            more, part = config.num_worlds * scale, budget.share(config.collect_share)
            worlds = self.worlds.play(real, searched, more, self._episodes_per_world(real), part)
        part = budget.share(config.posterior_share * scale, TRAIN_POSTERIOR_NET)
        updates, least = config.posterior_updates * scale, config.least_updates
        clock = TrainingClock(updates, part, "training the posterior network", least)
        loss = self.model.train_posterior_net(worlds, searched, errors, clock)
        size_px = np.abs(errors.keypoints)
        error_px = float(np.median(size_px)) if size_px.size else 0.0
        return {"loss/posterior_net": loss, "detector/error_px": error_px}

    def detect(self, trajectories: list[Trajectory]) -> Detected:
        return Detected(trajectories, [self.model.detect(t.frames) for t in trajectories])

    def curves(self, detected: Detected, searched: Distribution) -> np.ndarray:
        """(N, C) survival curves of the posterior network on the grid."""
        # As in a fit, one episode is held out as a test.
        num = Split.of(len(detected.trajectories)).num_fitted if self.is_fitted else None
        trajectories, detections = detected.trajectories[:num], detected.detections[:num]
        steps = min(len(t) for t in trajectories)
        actions = np.stack([t.actions[:steps] for t in trajectories])
        curves = self.model.curves(detections, actions, searched)
        grid = torch.tensor(candidate_grid(), dtype=torch.float32)
        return curves.prob_higher(grid.expand(1, len(searched.mean), -1))[0].numpy()

    def _episodes_per_world(self, real: list[Trajectory]) -> int:
        return min(self.config.episodes_per_world, len(real))
