"""Stores the latest simulated episodes, each frame once, for agents and an SPM to learn from."""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
import torch

from simtune.parameters import ParameterSpace
from simtune.replay_buffer.episodes import Episodes
from simtune.simulation import StrayLight

# Maps (m, S) full states, (m, N) parameters and stray light of m worlds to (m, H, W, 3) uint8:
# `Simulator.render`
Film = Callable[[np.ndarray, np.ndarray, StrayLight], np.ndarray]

_FIELDS_OF_ALL = ("parameters", "lengths", "terminated", "states", "actions", "rewards")
_FIELDS_OF_FILMED = ("full_states", "keypoints", "stray")  # frames can be drawn again
_CAPACITIES = ("filmed_capacity", "unfilmed_capacity")


@dataclass(frozen=True)
class StepIndex:
    """Index of steps, on the store's device, so that sampling does not wait for the host.

    Steps are numbered through all slots: those of slot e are `starts[e]` to `ends[e]` − 1. Its
    memory stays where it is, so a CUDA graph that samples sees what was added later.
    """

    starts: torch.Tensor  # (slots,)
    ends: torch.Tensor  # (slots,)
    terminals: torch.Tensor  # (slots,) the step that ended the task, or −1
    coordinates: torch.Tensor  # (slots, N) float32 parameters in [0, 1]
    totals: torch.Tensor  # (2,) numbers of all steps, and of filmed ones

    @classmethod
    def empty(cls, num_slots: int, num_parameters: int, device: torch.device | str) -> "StepIndex":
        """Without any step."""
        starts, ends, terminals = torch.zeros(3, num_slots, dtype=torch.int64, device=device)
        coordinates = torch.zeros(num_slots, num_parameters, device=device)
        totals = torch.zeros(2, dtype=torch.int64, device=device)
        return cls(starts, ends, terminals, coordinates, totals)


@dataclass(eq=False)
class EpisodeStore:
    """Slots for whole episodes; a new episode takes an empty slot, or else replaces the oldest.

    The first `filmed_capacity` slots are for episodes with frames; `unfilmed_capacity` further
    slots are for episodes without, which need little memory, so there may be many. Batches are
    gathered on `device`, so their data, including frames, is stored there. On a CPU, a slot's
    memory is used only once it is filled.
    """

    space: ParameterSpace
    _: KW_ONLY
    filmed_capacity: int
    unfilmed_capacity: int = 0
    device: torch.device | str = "cpu"

    def __post_init__(self) -> None:
        self.num_added = 0
        filmed_capacity, slots = self.filmed_capacity, self.filmed_capacity + self.unfilmed_capacity
        self._numbers = torch.full((slots,), -1)  # serial number of the episode; −1: empty
        nominal = np.tile(self.space.nominal, (slots, 1))
        self.parameters = torch.as_tensor(nominal)  # (slots, N) float64
        self.lengths = torch.zeros(slots, dtype=torch.int64)  # 0: the slot is empty
        self.terminated = torch.zeros(slots, dtype=torch.bool)
        # These get their sizes from the first episodes, or the first filmed ones.
        self.full_states = torch.empty(filmed_capacity, 0, dtype=torch.float64)  # (·, T + 1, S)
        self.stray = torch.empty(filmed_capacity, 0, dtype=torch.float64)  # (·, 6), `StrayLight`
        self.frames = torch.empty(filmed_capacity, 0, dtype=torch.uint8, device=self.device)
        self.keypoints = torch.empty(filmed_capacity, 0, device=self.device)  # (·, T + 1, L, 2)
        self.states = torch.empty(slots, 0, device=self.device)  # (slots, T + 1, D)
        self.actions = torch.empty(slots, 0, device=self.device)  # (slots, T, A)
        self.rewards = torch.empty(slots, 0, device=self.device)  # (slots, T)
        self._steps = StepIndex.empty(slots, len(self.space), self.device)

    def __len__(self) -> int:
        """Number of episodes."""
        return int((self.lengths > 0).sum())

    @property
    def num_steps(self) -> int:
        """Number of steps of all episodes."""
        return int(self.lengths.sum())

    @property
    def num_filmed_steps(self) -> int:
        """Number of steps of episodes with frames."""
        return int(self.lengths[: self.filmed_capacity].sum())

    def add(self, episodes: Episodes) -> None:
        """Store episodes with at least one step; if there are too many, the last ones.

        Raises ValueError if there are no slots for such episodes, or shapes differ from the first.
        """
        first, capacity, kind = self.filmed_capacity, self.unfilmed_capacity, "unfilmed"
        if episodes.frames is not None:
            first, capacity, kind = 0, self.filmed_capacity, "filmed"
        if capacity == 0:
            raise ValueError(f"no slot is for {kind} episodes; make the store with {kind}_capacity")
        not_empty = np.flatnonzero(episodes.lengths > 0)
        episodes = episodes.take(not_empty[-capacity:])
        by_age = self._numbers[first : first + capacity].argsort(stable=True)
        slots = first + by_age[: len(episodes)]
        names = (
            _FIELDS_OF_ALL
            if episodes.frames is None
            else (*_FIELDS_OF_ALL, *_FIELDS_OF_FILMED, "frames")
        )
        arrays = {name: getattr(episodes, name) for name in names}
        if episodes.frames is not None and episodes.stray is None:
            arrays["stray"] = StrayLight.none(len(episodes)).to_rows()
        self._write(slots, {k: torch.as_tensor(a) for k, a in arrays.items() if a is not None})
        self.num_added += len(not_empty)
        self._numbers[slots] = torch.arange(self.num_added - len(slots), self.num_added)
        self._locate_steps()

    def latest_filmed(self, num: int) -> torch.Tensor:
        """(at most num,) slots of the latest filmed episodes, oldest first."""
        numbers = self._numbers[: self.filmed_capacity]
        count = min(num, int((numbers >= 0).sum()))
        return numbers.argsort()[len(numbers) - count :]

    def numbers(self, slots: torch.Tensor) -> list[int]:
        """Serial numbers of the episodes in these slots; no two episodes have the same."""
        return self._numbers[slots].tolist()

    def tensors(self) -> dict[str, torch.Tensor]:
        """All stored data except the frames."""
        slots = self.lengths.nonzero()[:, 0]
        if not len(slots):
            return {}
        stored = {"slots": slots, "numbers": self._numbers[slots]}
        filmed = slots[slots < self.filmed_capacity]
        for names, kept in ((_FIELDS_OF_ALL, slots), (_FIELDS_OF_FILMED, filmed)):
            arrays = {name: getattr(self, name) for name in names}
            stored |= {name: array[kept.to(array.device)] for name, array in arrays.items()}
        return stored

    def state(self) -> dict[str, Any]:
        """Further data that `load` needs; JSON."""
        return {name: getattr(self, name) for name in ("num_added", *_CAPACITIES)}

    def load(
        self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any], film: Film
    ) -> None:
        """Restore a store from its `tensors` and `state`: the same episodes in the same slots.

        `film` draws the frames. Raises ValueError if the capacities differ.
        """
        for name in _CAPACITIES:
            if state[name] != getattr(self, name):
                raise ValueError(f"saved with {name}={state[name]}, got {getattr(self, name)}")
        self.num_added = state["num_added"]
        self.lengths[:], self._numbers[:] = 0, -1
        if tensors:
            slots = tensors["slots"]
            self._numbers[slots] = tensors["numbers"]
            self._write(slots, {name: tensors[name] for name in _FIELDS_OF_ALL})
            filmed = slots[slots < self.filmed_capacity]
            self._write(filmed, {name: tensors[name] for name in _FIELDS_OF_FILMED})
            for slot in filmed:  # one at a time: pictures are large
                self._film(slot, film)
        self._locate_steps()

    def _film(self, slot: torch.Tensor, film: Film) -> None:
        """Draw an episode's frames; those after its end are left black, and never read."""
        num_frames = int(self.lengths[slot]) + 1
        parameters = np.tile(self.parameters[slot].numpy(), (num_frames, 1))
        stray = StrayLight.from_rows(self.stray[slot].numpy()[None].repeat(num_frames, 0))
        drawn = film(self.full_states[slot, :num_frames].numpy(), parameters, stray)
        frames = np.zeros((1, self.full_states.shape[1], *drawn.shape[1:]), np.uint8)
        frames[0, :num_frames] = drawn
        self._write(slot[None], {"frames": torch.as_tensor(frames)})

    def _write(self, slots: torch.Tensor, arrays: Mapping[str, torch.Tensor]) -> None:
        """Write (n, ...) values of each array into n slots; nothing if one does not fit."""
        for name, values in arrays.items():
            array: torch.Tensor = getattr(self, name)
            if array.shape[1:] == (0,):
                setattr(self, name, array.new_empty(len(array), *values.shape[1:]))
            elif array.shape[1:] != values.shape[1:]:
                first, now = ([*a.shape[1:]] for a in (array, values))
                raise ValueError(f"{name} of an episode must be {first} as at first, got {now}")
        for name, values in arrays.items():
            array = getattr(self, name)
            for slot, value in zip(slots.tolist(), values, strict=True):
                array[slot] = value

    def _locate_steps(self) -> None:
        """Bring the index of steps up to date."""
        ends, index = self.lengths.cumsum(0), self._steps
        index.starts.copy_(ends - self.lengths)
        index.ends.copy_(ends)
        index.terminals.copy_(torch.where(self.terminated, ends - 1, -1))
        index.coordinates.copy_(torch.as_tensor(self.space.to_unit(self.parameters.numpy())))
        index.totals.copy_(torch.tensor([self.num_steps, self.num_filmed_steps]))
