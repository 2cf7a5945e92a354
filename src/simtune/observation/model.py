"""`ObservationModel`: what is observed of a real world, and how it differs from a simulator's."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simtune.cameras.footage import PLAIN, Footage
from simtune.cameras.views import View, apart
from simtune.observation.evidence import AllEvidence, Evidence
from simtune.observation.joints import JointSensor
from simtune.simulation import AnySimulator, Rollouts, StrayLight
from simtune.trajectory import Trajectory
from simtune.vision.image_noise import ImageNoise

# Of motion and of appearance, in unit coordinates: 2 % of a value, and the effect of shadows,
# highlights and video compression on a colour. Assumed, as no simulator can tell. A camera's effect
# on all colours together is in `image_noise`.
_DISCREPANCY_STD = (0.005, 0.02)
_MAX_LATENCY_STEPS = 2  # assumed maximal delay of a robot's actions


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera that films the world."""

    footage: Footage = PLAIN  # which of the model's cameras, and how it is recorded
    aspect: float = 1.0  # width over height of its view

    @property
    def name(self) -> str:
        """Name under which it is observed."""
        return self.footage.name


@dataclass(frozen=True, kw_only=True)
class ObservationModel:
    """What is observed: cameras, all real or all simulated, and sensors of joints.

    Each brings its own noise and likelihood: a camera that of the keypoints detected in its
    pictures, a sensor its own. Errors common to all are defined here.
    """

    cameras: tuple[Camera, ...]
    sensors: tuple[JointSensor, ...] = ()
    # By the tuned simulator: pictures are its own, pixel by pixel, actions take effect at once, and
    # there is no discrepancy
    is_simulated: bool = False

    @classmethod
    def of_simulator(
        cls, sensors: tuple[JointSensor, ...] = (), films: Sequence[Footage] = (PLAIN,)
    ) -> "ObservationModel":
        """A simulated real world; see `is_simulated`."""
        return replace(cls.of_reality(sensors, films), is_simulated=True)

    @classmethod
    def of_reality(
        cls, sensors: tuple[JointSensor, ...] = (), films: Sequence[Footage] = (PLAIN,)
    ) -> "ObservationModel":
        """A world filmed by real cameras, with usual assumptions."""
        return cls(cameras=tuple(Camera(footage=footage) for footage in films), sensors=sensors)

    @property
    def max_latency_steps(self) -> int:
        """Largest delay of actions, if no parameter describes it."""
        return 0 if self.is_simulated else _MAX_LATENCY_STEPS

    def unknown_latency_steps(self, simulator: AnySimulator) -> int:
        """Largest latency of actions to look for; 0 if a parameter describes it or nothing acts."""
        is_known = simulator.space.is_delay.any() or not simulator.num_actions
        return 0 if is_known else self.max_latency_steps

    def only(self, names: Collection[str]) -> "ObservationModel":
        """Only those named; "cameras" and "joints" stand for all of a kind."""
        sensors = tuple(s for s in self.sensors if s.name in names or "joints" in names)
        cameras = tuple(c for c in self.cameras if c.name in names or "cameras" in names)
        return replace(self, cameras=cameras, sensors=sensors)

    def framed(self, aspects: Sequence[float]) -> "ObservationModel":
        """With cameras whose views have these aspects."""
        both = zip(self.cameras, aspects, strict=True)
        return replace(self, cameras=tuple(replace(c, aspect=aspect) for c, aspect in both))

    def views(self, plates: Sequence[np.ndarray | None] | None = None) -> list[View]:
        """What a simulator must draw, in front of each camera's plate."""
        plates = plates or [None] * len(self.cameras)
        both = zip(self.cameras, plates, strict=True)
        return [
            View(c.footage.camera, c.aspect, plate, c.footage.background == "unknown")
            for c, plate in both
        ]

    @property
    def reading_labels(self) -> tuple[str, ...]:
        """Names of all readings, with the sensor's name where two sensors share one."""
        pairs = [(sensor.name, label) for sensor in self.sensors for label in sensor.joints]
        count = Counter(label for _, label in pairs)
        return tuple(f"{name}/{label}" if count[label] > 1 else label for name, label in pairs)

    @property
    def supersampling(self) -> int:
        """k × k points are averaged per pixel, as real cameras do; the simulator does not (1)."""
        return 2 if self._is_filmed else 1

    @property
    def image_noise(self) -> ImageNoise | None:
        """What each camera adds to drawn pictures."""
        return ImageNoise() if self._is_filmed else None

    @property
    def _is_filmed(self) -> bool:
        """Whether there are real cameras."""
        return bool(self.cameras) and not self.is_simulated

    def stray_light(self, num: int, rng: np.random.Generator) -> StrayLight | None:
        """For `num` rooms with cameras; None if pictures are the simulator's own."""
        return StrayLight.draw(num, rng) if self.image_noise else None

    def add_noise(
        self, simulator: AnySimulator, frames: np.ndarray, rng: np.random.Generator
    ) -> None:
        """To (W, F, H, W, 3) uint8 drawn frames, in place: each of W worlds has its own cameras."""
        if noise := self.image_noise:
            for view in apart(frames, simulator.widths):
                noise.apply(view, rng)

    def discrepancy_std(self, is_appearance: np.ndarray) -> np.ndarray:
        """(N,) standard deviations, in unit coordinates, of errors that all data share.

        No fit can detect them; a simulator's own data have none.
        """
        motion, appearance = _DISCREPANCY_STD
        return np.where(is_appearance, appearance, motion) * (not self.is_simulated)

    @property
    def periods(self) -> dict[str, np.ndarray]:
        """{sensor: (D,)}; see `JointSensor.periods`."""
        return {sensor.name: sensor.periods for sensor in self.sensors}

    def in_units(self, recorded: Mapping[str, np.ndarray], step_s: float) -> dict[str, np.ndarray]:
        """{sensor: (T + 1, D)} readings of a recorded episode; see `JointSensor.from_recorded`."""
        return {s.name: s.from_recorded(recorded[s.name], step_s) for s in self.sensors}

    def observe_beside(self, *others: Callable[[Any], np.ndarray]) -> Callable[[Any], np.ndarray]:
        """(n, D) observations of n worlds by `others`, such as keypoints, then by all sensors."""
        if len(others) == 1 and not self.sensors:
            return others[0]
        eyes = [*others, *(sensor.observe for sensor in self.sensors)]
        return lambda batch: np.hstack([np.zeros((batch.nsim, 0)), *(see(batch) for see in eyes)])

    def evidence(self, tracks: Evidence, readings: Mapping[str, np.ndarray]) -> AllEvidence:
        """From the tracks in pictures, and from {sensor: (E, T + 1, D)} readings."""
        others = (sensor.evidence(readings[sensor.name]) for sensor in self.sensors)
        return AllEvidence((tracks, *others))

    def readings(self, observed: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """{sensor: (..., D)} readings with noise, from noise-free observations of all sensors."""
        readings, start = {}, 0
        for sensor in self.sensors:
            end = start + sensor.size
            readings[sensor.name] = sensor.measure(observed[..., start:end], rng)
            start = end
        return readings

    def record(
        self, simulator: AnySimulator, rollouts: Rollouts, rng: np.random.Generator
    ) -> list[Trajectory]:
        """Recordings of simulated episodes, all filmed by the same cameras.

        `rollouts` must have been played with `observe_beside()`, for the sensors' readings.
        """
        frames = self._film(simulator, rollouts, rng)
        readings = self.readings(rollouts.observed, rng)
        return [
            Trajectory(
                frames[i],
                rollouts.actions[i].astype(np.float32),
                simulator.step_s,
                {name: values[i] for name, values in readings.items()},
            )
            for i in range(len(rollouts))
        ]

    def _film(
        self, simulator: AnySimulator, rollouts: Rollouts, rng: np.random.Generator
    ) -> np.ndarray:
        """(n, T + 1, H, W, 3); without a camera there are no pixels."""
        if not self.cameras:
            return np.empty((*rollouts.states.shape[:2], 0, 0, 3), np.uint8)
        room = self.stray_light(1, rng)
        frames = simulator.film(rollouts, room and room.of(np.zeros(len(rollouts), int)))
        self.add_noise(simulator, frames.reshape(1, -1, *frames.shape[2:]), rng)
        return frames
