"""What the detector found, in simulated worlds and in the real one."""

from collections.abc import Sequence
from typing import NamedTuple

from simtune.search_param_model.simulated import SimulatedWorlds
from simtune.trajectory import Trajectory
from simtune.vision.detections import Detections
from simtune.vision.detector_noise import DetectorNoise


class HeldOut(NamedTuple):
    """Worlds that the detector was not trained on, and its detections there."""

    worlds: SimulatedWorlds
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
