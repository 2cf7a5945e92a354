"""What a student's detector saw in remembered episodes.

The detector changes as it learns, so its detections get old. To make all of them anew after each
batch of episodes took a fifth of a training's time; the oldest few are enough.
"""

from collections.abc import Callable, Mapping, Sequence

import torch

_TENSORS = ("numbers", "detected")


class Recollection:
    """Detections in episodes, by their serial numbers."""

    def __init__(self, num_renewed: int):
        """`num_renewed`: how many of the episodes seen before are looked at again."""
        self._num_renewed = num_renewed
        self._detected: dict[int, torch.Tensor] = {}  # (T + 1, F) each, the oldest first

    def look(self, numbers: Sequence[int], detect: Callable[[int], torch.Tensor]) -> torch.Tensor:
        """(n, T + 1, F) detections in the n episodes of these numbers; all others are forgotten.

        `detect(i)`: (T + 1, F) by the present detector in the episode `numbers[i]`.
        """
        kept = {number: seen for number, seen in self._detected.items() if number in numbers}
        for oldest in list(kept)[: self._num_renewed]:
            del kept[oldest]
        for i, number in enumerate(numbers):
            if number not in kept:
                kept[number] = detect(i)
        self._detected = kept
        return torch.stack([kept[number] for number in numbers])

    def tensors(self) -> dict[str, torch.Tensor]:
        """For a checkpoint."""
        if not self._detected:
            return {}
        stored = torch.tensor(list(self._detected)), torch.stack([*self._detected.values()])
        return dict(zip(_TENSORS, stored, strict=True))

    def load(self, tensors: Mapping[str, torch.Tensor], device: torch.device) -> None:
        """The inverse of `tensors`."""
        numbers, detected = (tensors.get(name, ()) for name in _TENSORS)
        pairs = zip(numbers, detected, strict=True)
        self._detected = {int(number): seen.to(device) for number, seen in pairs}
