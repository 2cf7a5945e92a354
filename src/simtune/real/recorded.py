"""The real world as a folder of recordings: what was filmed is all there will ever be."""

from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.recordings import Recording, read_dataset, read_meta
from simtune.simulation import PixelPolicy
from simtune.trajectory import Trajectory

_A_FEW = 10  # episodes taken where no number is asked for: more would mostly cost memory


class RecordedReal:
    """A LeRobotDataset v3.0 in the place of a robot.

    Making one reads meta/ only; frames are decoded when they are first asked for, and kept.
    `camera`, `image_size` and `num_actions`: see `read_dataset`.

    Raises:
        InputError: the dataset is unsound; one line says what was expected and what to do.
    """

    looks_like_simulator = False  # a camera filmed it, as far as anybody knows

    def __init__(
        self,
        folder: str | Path,
        *,
        camera: str | None = None,
        image_size: tuple[int, int] | int | None = None,
        num_actions: int | None = None,
    ):
        self._meta = read_meta(folder, camera=camera, num_actions=num_actions)
        self._image_size = image_size
        self._recording: Recording | None = None
        self._num_collected = 0

    @property
    def step_s(self) -> float:
        return 1 / self._meta.fps

    @property
    def num_actions(self) -> int:
        return self._meta.num_actions

    @property
    def num_episodes(self) -> int:
        """How many episodes there are to collect."""
        return len(self._meta.episodes)

    @property
    def facts(self) -> dict[str, Any]:
        """What to note down of what was collected; JSON. Empty before there is any."""
        if self._recording is None:
            return {}
        collected = self._recording.trajectories[: self._num_collected]
        steps = sum(len(trajectory) for trajectory in collected)
        return self._recording.facts | {"episodes": len(collected), "steps": steps}

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """The first `num_episodes` episodes (None: all, at most 10), the same at every call.

        Raises:
            InputError: more are asked for than there are, or the dataset is unsound.
        """
        if num_episodes is None:
            num_episodes = min(self.num_episodes, _A_FEW)
        if not 1 <= num_episodes <= self.num_episodes:
            raise InputError(
                f"{self._meta.folder}: {num_episodes} episodes asked for, it holds "
                f"{self.num_episodes}; ask for 1 to {self.num_episodes}"
            )
        num_decoded = 0 if self._recording is None else len(self._recording.trajectories)
        if self._recording is None or num_decoded < num_episodes:
            # Decoding starts at the front each time; doubling keeps asking for one more cheap.
            self._recording = read_dataset(
                self._meta.folder,
                camera=self._meta.camera,
                image_size=self._image_size,
                max_episodes=max(num_episodes, 2 * num_decoded),
            )
        self._num_collected = max(self._num_collected, num_episodes)
        return self._recording.trajectories[:num_episodes]

    def try_out(
        self, policy: PixelPolicy, num_stacked: int, num_episodes: int, seed: int
    ) -> list[Trajectory]:
        """Nothing: what was filmed is all there will ever be."""
        return []
