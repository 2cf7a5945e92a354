"""A reality gap: what a real robot and its camera do and the simulator does not."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simtune.config import RealConfig
from simtune.errors import InputError
from simtune.pictures import resize
from simtune.recordings import decode, write_video
from simtune.simulation import OPENGL_DM_CONTROL, LiveCamera, Simulator
from simtune.tasks import AnyTask, Task
from simtune.views import View

_DRAWN_PX = 128  # side of what the camera sees
_BRIGHTNESS = (0.9, 1.1)
_NOISE_SD = 0.02 * 255  # of each channel of a pixel


@dataclass(frozen=True)
class RealityGap:
    """A pseudo-real world behind it moves late and looks unlike the simulator.

    The robot follows an action one step late, and stands still until then. The camera is of
    another renderer, with shadows, reflections and smooth edges; it has a brightness and noise of
    its own, and what it films was a compressed video in between.
    """

    image_size: int
    brightness: float  # a factor on every pixel
    delay_steps: int = 1

    @classmethod
    def of(cls, config: RealConfig, image_size: int) -> "RealityGap | None":
        """The gap that a command asks for, which its seed draws."""
        return cls.draw(image_size, config.seed) if config.real_gap else None

    @classmethod
    def draw(cls, image_size: int, seed: int) -> "RealityGap":
        """The gap of a seed."""
        rng = np.random.default_rng((seed, 1))  # not the numbers that the start is drawn by
        return cls(image_size, rng.uniform(*_BRIGHTNESS))

    @staticmethod
    def simulator(task: AnyTask, views: Sequence[View] | None = None) -> Simulator:
        """What draws the world behind the gap.

        Raises InputError where there is no OpenGL, or no model to draw.
        """
        if not isinstance(task, Task):
            raise InputError("--real-gap needs a MuJoCo model, to draw it another way")
        options = {"renderer": "opengl", "quality": OPENGL_DM_CONTROL}
        return task.simulator(image_size=_DRAWN_PX, views=views, **options)

    def camera(self, step_s: float, rng: np.random.Generator) -> LiveCamera:
        """What a policy sees through, of n worlds at once: no frame depends on others."""
        return LiveCamera(self.image_size, lambda drawn: self.film(drawn, step_s, rng))

    def film(self, frames: np.ndarray, step_s: float, rng: np.random.Generator) -> np.ndarray:
        """(T, H, W, 3) uint8 as drawn to (T, image_size, W', 3) uint8 as recorded."""
        size = (self.image_size, self.image_size * frames.shape[2] // frames.shape[1])
        small = np.stack([resize(frame, size) for frame in frames])
        noise = rng.normal(0, _NOISE_SD, small.shape)
        seen = np.rint(self.brightness * small + noise).clip(0, 255).astype(np.uint8)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "camera.mp4"
            # Without whole frames only, x264 looks ahead, and on some CPUs never twice alike.
            write_video(path, seen, fps=1 / step_s, keyframe_interval=1)
            recorded = np.stack([frame for _, frame in decode(path)])
        return recorded[:, : size[0], : size[1]]  # odd sizes come padded
