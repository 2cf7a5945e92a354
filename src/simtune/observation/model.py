"""`ObservationModel`: what is observed of a real world, and how that differs from a simulator's."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from simtune.errors import InputError
from simtune.footage import PLAIN, Footage
from simtune.observation.evidence import AllEvidence, Evidence
from simtune.simulation import AnySimulator, Rollouts, StrayLight
from simtune.trajectory import Trajectory
from simtune.views import View, apart
from simtune.vision.image_noise import ImageNoise

# Of motion and of appearance, in unit coordinates: 2 % of a value, and what shadows, highlights and
# a video's coding make of a colour. Assumed, as no simulator can tell them. What a camera's
# brightness and tint make of all colours together is said by `image_noise`.
_DISCREPANCY_STD = (0.005, 0.02)
_MAX_LATENCY_STEPS = 2  # by which a robot's actions are taken to be late at most


class Sensor(Protocol):
    """What is measured of the real world beside its pictures, such as joint angles.

    Trajectories have its readings, (T + 1, D), by its name.
    """

    @property
    def name(self) -> str: ...

    @property
    def labels(self) -> tuple[str, ...]:
        """(D,) what each number of a reading is of."""
        ...

    @property
    def size(self) -> int:
        """D, numbers in a reading."""
        ...

    def observe(self, batch: Any) -> np.ndarray:
        """(n, D) what it would measure of n simulated worlds' present state, without noise."""
        ...

    @property
    def columns(self) -> tuple[str, ...]:
        """Of recordings, where its readings are."""
        ...

    def from_recorded(self, recorded: np.ndarray, step_s: float) -> np.ndarray:
        """(T + 1, D) readings, of the moments of the frames; `recorded`: as they were written."""
        ...

    def to_recorded(self, readings: np.ndarray) -> np.ndarray:
        """(..., D) as they are written."""
        ...

    def measure(self, observed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(..., D) readings of what was observed without noise, with the noise of the real one."""
        ...

    def evidence(self, readings: np.ndarray) -> Evidence:
        """What (E, T + 1, D) readings say."""
        ...


@dataclass(frozen=True, kw_only=True)
class Camera:
    """What films, and whether its pictures are the simulator's own, pixel by pixel."""

    same_renderer: bool
    footage: Footage = PLAIN  # of which of the model's cameras, and how it is recorded
    aspect: float = 1.0  # width over height of what is looked at

    @property
    def name(self) -> str:
        """By which it is observed."""
        return self.footage.name

    @property
    def supersampling(self) -> int:
        """k × k points of each pixel are averaged: a real camera does so, the simulator not."""
        return 1 if self.same_renderer else 2

    @property
    def image_noise(self) -> ImageNoise | None:
        """What the camera adds to pictures as they are drawn."""
        return None if self.same_renderer else ImageNoise()


@dataclass(frozen=True, kw_only=True)
class ObservationModel:
    """What is observed: cameras, which are all real or all simulated, and sensors beside them.

    Each brings its own noise and likelihood: a camera's is that of the keypoints detected in its
    pictures, a sensor says it itself. What goes wrong with all alike is said here.
    """

    cameras: tuple[Camera, ...]
    sensors: tuple[Sensor, ...] = ()
    max_latency_steps: int  # by which actions may take effect late, if no parameter says so
    is_simulated: bool = False  # by the simulator that is tuned: nothing is wrong with the data

    @classmethod
    def of_simulator(
        cls, sensors: tuple[Sensor, ...] = (), films: Sequence[Footage] = (PLAIN,)
    ) -> "ObservationModel":
        """A real world that is simulated: its pictures are the simulator's, its actions prompt."""
        cameras = tuple(Camera(same_renderer=True, footage=footage) for footage in films)
        return cls(cameras=cameras, sensors=sensors, max_latency_steps=0, is_simulated=True)

    @classmethod
    def of_reality(
        cls, sensors: tuple[Sensor, ...] = (), films: Sequence[Footage] = (PLAIN,)
    ) -> "ObservationModel":
        """A world that real cameras film, as far as anybody knows."""
        cameras = tuple(Camera(same_renderer=False, footage=footage) for footage in films)
        return cls(cameras=cameras, sensors=sensors, max_latency_steps=_MAX_LATENCY_STEPS)

    def only(self, names: Collection[str] | None) -> "ObservationModel":
        """Of these alone, by name; "cameras" and "joints" stand for all of a kind, None for all."""
        if names is None:
            return self
        sensors = tuple(s for s in self.sensors if s.name in names or "joints" in names)
        cameras = tuple(c for c in self.cameras if c.name in names or "cameras" in names)
        return replace(self, cameras=cameras, sensors=sensors)

    def framed(self, aspects: Sequence[float]) -> "ObservationModel":
        """Of cameras whose views have these aspects."""
        both = zip(self.cameras, aspects, strict=True)
        return replace(self, cameras=tuple(replace(c, aspect=aspect) for c, aspect in both))

    def views(self, plates: Sequence[np.ndarray | None] | None = None) -> list[View]:
        """What a simulator has to draw, before the `plates` of each camera."""
        plates = plates or [None] * len(self.cameras)
        both = zip(self.cameras, plates, strict=True)
        return [View(c.footage.camera, c.aspect, plate) for c, plate in both]

    @property
    def reading_labels(self) -> tuple[str, ...]:
        """What each number is of, that the sensors measure; one that two measure tells which."""
        every = [(sensor.name, label) for sensor in self.sensors for label in sensor.labels]
        count = Counter(label for _, label in every)
        return tuple(f"{name}/{label}" if count[label] > 1 else label for name, label in every)

    @property
    def supersampling(self) -> int:
        """See `Camera`; 1 where nothing is filmed."""
        return self.cameras[0].supersampling if self.cameras else 1

    @property
    def same_renderer(self) -> bool:
        """Whether pictures are the simulator's own."""
        return self.cameras[0].same_renderer

    @property
    def image_noise(self) -> ImageNoise | None:
        """What each camera adds to pictures as they are drawn."""
        return self.cameras[0].image_noise if self.cameras else None

    def stray_light(self, num: int, rng: np.random.Generator) -> StrayLight | None:
        """Of `num` rooms in which cameras film; None where pictures are the simulator's own."""
        return StrayLight.draw(num, rng) if self.image_noise else None

    def add_noise(
        self, simulator: AnySimulator, frames: np.ndarray, rng: np.random.Generator
    ) -> None:
        """To (W, F, H, W, 3) uint8 as drawn, in place: W worlds, with cameras of their own."""
        if noise := self.image_noise:
            for view in apart(frames, simulator.widths):
                noise.apply(view, rng)

    def discrepancy_std(self, is_appearance: np.ndarray) -> np.ndarray:
        """(N,) standard deviations, in unit coordinates, of what is wrong with all data alike.

        No fit can see it, and a simulator's own data have none of it.
        """
        motion, appearance = _DISCREPANCY_STD
        return np.where(is_appearance, appearance, motion) * (not self.is_simulated)

    def in_units(
        self, recorded: Mapping[str, np.ndarray], step_s: float, where: str
    ) -> dict[str, np.ndarray]:
        """{sensor: (T + 1, D)} readings of an episode of recordings; see `Sensor.from_recorded`.

        Raises InputError, with `where` they lie, for more or fewer numbers than a sensor has.
        """
        for sensor in self.sensors:
            if (count := recorded[sensor.name].shape[1]) != sensor.size:
                raise InputError(
                    f"{where}: {', '.join(sensor.columns)} holds {count} numbers, sensor "
                    f"{sensor.name} has {sensor.size} joints; name a column for each joint"
                )
        return {s.name: s.from_recorded(recorded[s.name], step_s) for s in self.sensors}

    def observe_beside(self, *others: Callable[[Any], np.ndarray]) -> Callable[[Any], np.ndarray]:
        """(n, D) what others, such as keypoints, and then all sensors would measure of n worlds."""
        if len(others) == 1 and not self.sensors:
            return others[0]
        every = [*others, *(sensor.observe for sensor in self.sensors)]
        return lambda batch: np.hstack([np.zeros((batch.nsim, 0)), *(see(batch) for see in every)])

    def evidence(self, tracks: Evidence, readings: Mapping[str, np.ndarray]) -> AllEvidence:
        """That of what was detected in the pictures, and of {sensor: (E, T + 1, D)} readings."""
        others = (sensor.evidence(readings[sensor.name]) for sensor in self.sensors)
        return AllEvidence((tracks, *others))

    def readings(self, observed: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """{sensor: (..., D)} readings of what all sensors would measure without noise."""
        readings, start = {}, 0
        for sensor in self.sensors:
            end = start + sensor.size
            readings[sensor.name] = sensor.measure(observed[..., start:end], rng)
            start = end
        return readings

    def record(
        self, simulator: AnySimulator, rollouts: Rollouts, rng: np.random.Generator
    ) -> list[Trajectory]:
        """What would be recorded of simulated episodes: the same cameras film all.

        `rollouts` were played with `observe_beside()`, so that sensors have their readings.
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
