"""A reality gap: effects of a real robot and its camera that the simulator lacks."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simtune.cameras.pictures import resize
from simtune.cameras.views import View
from simtune.config import RealConfig
from simtune.errors import InputError
from simtune.random_streams import Purpose, stream
from simtune.recordings import decode, write_video
from simtune.simulation import OPENGL_DM_CONTROL, LiveCamera, Simulator
from simtune.tasks import AnyTask, Task

_DRAWN_PX = 128  # height of the drawn pictures
_BRIGHTNESS = (0.9, 1.1)
_NOISE_SD = 0.02 * 255  # for each channel of a pixel


@dataclass(frozen=True)
class RealityGap:
    """Makes a pseudo-real world move late and look unlike the simulator.

    The robot follows actions one step late: it carries out the first for two steps, and the last
    not at all. The camera uses another renderer, with shadows, reflections and smooth edges. Its
    pictures have their own brightness and noise, and pass through a compressed video.
    """

    image_size: int
    brightness: float  # a factor on every pixel
    delay_steps: int = 1

    @classmethod
    def of(cls, config: RealConfig, image_size: int) -> "RealityGap | None":
        """The gap drawn by the command's seed; None without --real-gap."""
        return cls.draw(image_size, config.seed) if config.real_gap else None

    @classmethod
    def draw(cls, image_size: int, seed: int) -> "RealityGap":
        """The gap drawn by a seed."""
        rng = stream(seed, Purpose.REALITY_GAP)
        return cls(image_size, rng.uniform(*_BRIGHTNESS))

    @staticmethod
    def simulator(task: AnyTask, views: Sequence[View] | None = None) -> Simulator:
        """The simulator that draws the world behind the gap.

        Raises InputError if there is no OpenGL, no model to draw, or a background picture.
        """
        if not isinstance(task, Task):
            raise InputError("--real-gap needs a MuJoCo model, to draw it another way")
        if any(view.plate is not None for view in views or ()):
            raise InputError(
                "--real-gap draws by OpenGL, which cannot draw the tuning file's background "
                "picture: leave --real-gap or background = FILE out"
            )
        options = {"renderer": "opengl", "quality": OPENGL_DM_CONTROL}
        return task.simulator(image_size=_DRAWN_PX, views=views, **options)

    def camera(self, step_s: float, rng: np.random.Generator) -> LiveCamera:
        """The camera that shows n worlds to a policy; no frame depends on other frames."""
        return LiveCamera(self.image_size, lambda drawn: self.film(drawn, step_s, rng))

    def film(self, frames: np.ndarray, step_s: float, rng: np.random.Generator) -> np.ndarray:
        """Turn drawn frames (T, H, W, 3) uint8 into recorded ones (T, image_size, W', 3) uint8."""
        size = (self.image_size, self.image_size * frames.shape[2] // frames.shape[1])
        small = np.stack([resize(frame, size) for frame in frames])
        noise = rng.normal(0, _NOISE_SD, small.shape)
        seen = np.rint(self.brightness * small + noise).clip(0, 255).astype(np.uint8)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "camera.mp4"
            # Keyframes only: otherwise x264 looks ahead, which is not reproducible on some CPUs.
            write_video(path, seen, fps=1 / step_s, keyframe_interval=1)
            recorded = np.stack([frame for _, frame in decode(path)])
        return recorded[:, : size[0], : size[1]]  # odd sizes were padded
