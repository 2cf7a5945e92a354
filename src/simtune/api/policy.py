"""A trained policy, for a loop of one's own: a camera's picture in, an action out."""

from collections import deque
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.evaluation.evaluate import load_trained
from simtune.simulation import scale_actions


class Policy:
    """Acts on the pictures of one camera; made by `Result.policy`.

    Call `reset` before each episode, and then `act` once in each step of `step_s` seconds.
    """

    def __init__(self, run: Path):
        """Of a training's newest checkpoint. Raises ValueError if there is no policy."""
        self._trained = load_trained(run)
        self._latest = deque[np.ndarray](maxlen=self._trained.schedule.num_stacked)
        self._shape: tuple[int, ...] = ()  # of the episode's pictures, as given

    @property
    def step_s(self) -> float:
        """Seconds from one picture to the next."""
        return self._trained.learnt_in.simulator.step_s

    @property
    def action_names(self) -> tuple[str, ...]:
        """What the numbers of an action are, in order."""
        return tuple(self._trained.learnt_in.simulator.action_mapping.names)

    def reset(self) -> None:
        """Begin an episode: earlier pictures and actions are forgotten."""
        self._latest.clear()
        self._trained.agent.begin_episodes()

    def act(self, picture: np.ndarray) -> np.ndarray:
        """The (A,) action for a picture (H, W, 3) uint8, RGB, as in the task's recordings.

        Of a wide picture the square in the middle is used, as in training. Raises ValueError for
        anything else, and for another size than that of the episode's first picture.
        """
        picture = np.asarray(picture)
        if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
            raise InputError(
                f"expected a picture (H, W, 3) uint8, got {picture.shape} {picture.dtype}"
            )
        footage, size = self._trained.task.cameras[0], self._trained.schedule.image_size
        footage.aspect(picture.shape)  # refuses upright pictures
        if self._latest and picture.shape != self._shape:
            raise InputError(
                f"expected a picture {self._shape}, as at this episode's start, got "
                f"{picture.shape}: call reset before an episode of another size"
            )
        seen = footage.as_pinhole(picture, (size, size))
        self._shape = picture.shape
        most = self._latest.maxlen or 1
        self._latest.extend([seen] * (1 if self._latest else most))  # the first one stands alone
        action = self._trained.agent.act(np.stack(self._latest)[None])
        return scale_actions(self._trained.learnt_in.simulator.action_mapping, action)[0]
