"""Moving parts in the real video beside the simulator's, before and after, replayed open loop."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.run.files import plain
from simtune.simulation import Simulator
from simtune.vision.detector import Detections
from simtune.vision.keypoints import Keypoints

_SURE = 0.5  # probability that a keypoint is where it was detected; elsewhere it counts as unseen
_END = 0.1  # of an episode, at its end
_ALONG_PX, _LOST = 2.0, 3  # off by more than so much, in so many pictures that show it: it is lost


@dataclass(frozen=True)
class MovingParts:
    """L keypoints of an episode's T + 1 pictures, in pixels; NaN where nothing is known."""

    parts: tuple[str, ...]  # (L,) the body of each
    detected: np.ndarray  # (T + 1, L, 2)
    before: np.ndarray  # by the same actions in the simulator
    after: np.ndarray

    def distances(self) -> dict[str, dict[str, np.ndarray]]:
        """{part: {"before", "after": (T + 1,) pixels from where it is detected}}."""
        found = {}
        for part in dict.fromkeys(self.parts):
            its = np.array(self.parts) == part
            found[part] = {
                "before": _distance(self.before[:, its], self.detected[:, its]),
                "after": _distance(self.after[:, its], self.detected[:, its]),
            }
        return found

    def scores(self) -> dict[str, dict[str, Any]]:
        """{part: medians of that, over the episode and its end, and how long it is within 2 px}.

        A detector slips now and then, hence medians. In pixels, and pictures; JSON.
        """
        found = {}
        for part, its in self.distances().items():
            last = max(1, round(_END * len(its["after"])))
            told = {
                f"{figure}{when}": value
                for when, key in (("_before", "before"), ("", "after"))
                for figure, value in (
                    ("px", _median(its[key])),
                    ("end_px", _median(its[key][-last:])),
                    ("pictures_along", _along(its[key])),
                )
            }
            found[part] = plain(told)
        return found

    def to_json(self) -> dict[str, Any]:
        films = {"detected": self.detected, "before": self.before, "after": self.after}
        rounded = {name: np.round(its, 2).tolist() for name, its in films.items()}
        return plain({"parts": list(self.parts), **rounded})

    @classmethod
    def from_json(cls, known: dict[str, Any]) -> "MovingParts":
        """The inverse. Raises KeyError, TypeError or ValueError for anything else."""
        parts = tuple(map(str, known["parts"]))
        films = [np.array(known[name], float) for name in ("detected", "before", "after")]
        if any(its.ndim != 3 or its.shape[1:] != (len(parts), 2) for its in films):
            raise ValueError(f"{len(parts)} keypoints of shapes {[its.shape for its in films]}")
        steps = min(map(len, films))
        return cls(parts, *(its[:steps] for its in films))


def follow_parts(
    simulator: Simulator,
    keypoints: Keypoints,
    detections: Detections,
    actions: np.ndarray,
    start: np.ndarray,
    parameters: tuple[np.ndarray, np.ndarray],
) -> MovingParts:
    """An episode of (T, A) actions from the state `start` (S,).

    `detections`: in its T + 1 real pictures; `parameters`: (N,) before and after.
    """
    model = simulator.model
    bodies = model.body_weldid[model.geom_bodyid[keypoints.geoms]].tolist()
    played = simulator.roll_out(
        np.stack(parameters),
        np.repeat(actions[None].astype(float), 2, 0),
        np.random.default_rng(0),  # unused: the start is given
        keypoints.observe,
        starts=np.repeat(start[None], 2, 0),
        keep_diverged=True,
    )
    before, after = played.observed.reshape(2, len(actions) + 1, len(keypoints), 2)
    is_sure = detections.probability[:, 0] >= _SURE
    return MovingParts(
        tuple(model.body(body).name or f"body {body}" for body in bodies),
        np.where(is_sure[..., None], detections.keypoints, np.nan),
        before,
        after,
    )


def _distance(simulated: np.ndarray, detected: np.ndarray) -> np.ndarray:
    """(T + 1,) root mean square over a part's (T + 1, K, 2) keypoints that are seen, else NaN."""
    squared = np.square(simulated - detected).sum(-1)
    seen = np.isfinite(squared)
    total = np.where(seen, squared, 0.0).sum(1)
    return np.where(seen.any(1), np.sqrt(total / np.maximum(seen.sum(1), 1)), np.nan)


def _median(distances: np.ndarray) -> float:
    known = distances[np.isfinite(distances)]
    return float(np.median(known)) if len(known) else np.nan


def _along(distances: np.ndarray) -> int | None:
    """Pictures before the part is lost; those that do not show it do not count. None: never."""
    known = np.flatnonzero(np.isfinite(distances))
    off = distances[known] > _ALONG_PX
    runs = [i for i in range(len(off) - _LOST + 1) if off[i : i + _LOST].all()]
    return int(known[runs[0]]) if runs else None
