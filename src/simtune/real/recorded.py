"""The real world as recordings: no further data can be collected."""

from dataclasses import replace
from typing import Any

from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.real import RealWorld
from simtune.recordings import Dataset
from simtune.trajectory import Trajectory

_DEFAULT_EPISODES = 10  # if no number is given: more would mostly cost memory


class RecordedReal(RealWorld):
    """A dataset as the real world. Episodes are read when first asked for, and kept."""

    def __init__(self, dataset: Dataset, observation: ObservationModel | None = None):
        """`observation`: the sensors the dataset was opened with; by default one camera."""
        self.observation = observation or ObservationModel.of_reality()
        self._dataset, self.step_s = dataset, dataset.step_s
        self._collected: list[Trajectory] = []

    @property
    def num_episodes(self) -> int:
        """Number of episodes in the dataset."""
        return self._dataset.num_episodes

    @property
    def facts(self) -> dict[str, Any]:
        """Facts about the collected episodes; JSON. Empty before any is collected."""
        return self._dataset.facts(len(self._collected)) if self._collected else {}

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """The first `num_episodes` episodes (None: all, at most 10), the same at every call.

        Raises:
            InputError: there are fewer episodes, or one is unsound.
        """
        num_episodes = how_many(self._dataset, num_episodes)
        for episode in range(len(self._collected), num_episodes):
            self._collected.append(read_episode(self._dataset, episode, self.observation))
        return self._collected[:num_episodes]


class ClosedReal(RealWorld):
    """The real world of a finished training: filmed by a camera, it gives no more episodes."""

    def __init__(self, step_s: float, observation: ObservationModel):
        self.step_s, self.observation = step_s, observation

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """An empty list: recordings may be gone, and no robot moves."""
        return []


def read_episode(
    dataset: Dataset, episode: int, observation: ObservationModel, *, pictures: bool = True
) -> Trajectory:
    """An episode, with readings in the units of the sensors that the dataset was opened with.

    Without `pictures`, none is decoded, and frames are empty. Raises InputError if the episode is
    unsound, or a sensor has another number of joints.
    """
    read = dataset.read(episode, observation.periods, pictures=pictures)
    try:
        readings = observation.in_units(read.readings, dataset.step_s)
    except InputError as error:
        raise InputError(f"{dataset.where}: {dataset.episodes[episode]}: {error}") from error
    return replace(read, readings=readings)


def how_many(dataset: Dataset, asked: int | None) -> int:
    """Number of episodes to read; `asked` None: a few. Raises InputError if there are fewer."""
    there = dataset.num_episodes
    if asked is None:
        return min(there, _DEFAULT_EPISODES)
    if not 1 <= asked <= there:
        besides = " besides those left out" if dataset.num_left_out else ""
        raise InputError(
            f"{dataset.where}: {asked} episodes asked for, it holds {there}{besides}; ask for 1 to "
            f"{there}"
        )
    return asked
