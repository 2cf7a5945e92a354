"""What all parts of a fit share: a simulator, first guesses at states, and what is unknown."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simtune.fit.lateness import Lateness
from simtune.fit.motion.estimator import StateEstimator
from simtune.fit.motion.shooting import Shooting
from simtune.fit.motion.shooting_config import ShootingConfig
from simtune.fit.physics import Physics
from simtune.fit.readings.joint_motion import JointMotion
from simtune.fit.sizing import FitConfig, FitWork
from simtune.parameters import ParameterSpace


@dataclass(frozen=True)
class FitSetup:
    """Immutable. With `joints` the readings give the robot's motion; see `ReplayFit`."""

    physics: Physics
    estimator: StateEstimator
    config: FitConfig
    joints: JointMotion | None = None

    @property
    def space(self) -> ParameterSpace:
        return self.physics.parameters

    @cached_property
    def moving(self) -> np.ndarray:
        """(P,) indices of the parameters that the motion is fitted by; others are held."""
        return np.setdiff1d(np.flatnonzero(~self.space.is_appearance), self.config.held)

    @cached_property
    def prior_std(self) -> np.ndarray:
        """(2 nv,) usual errors of first guesses at states; 0: known."""
        usual = self.estimator.prior_std
        return usual if self.joints is None else np.where(self.joints.is_known, 0.0, usual)

    def work(self, num_steps: int) -> FitWork:
        """For episodes of `num_steps` in all."""
        return FitWork(num_steps, int((self.prior_std > 0).sum()), len(self.moving))

    def shooting(
        self,
        fitted: np.ndarray,
        config: ShootingConfig | None = None,
        lateness: Lateness | None = None,
    ) -> Shooting:
        """Of the parameters `fitted`, (P,) indices; by default with the fit's own settings."""
        config = config or self.config.shooting
        config = config.where_pictures_are_late() if lateness else config
        return Shooting(self.physics, self.prior_std, fitted, config, lateness)
