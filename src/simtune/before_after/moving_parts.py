"""Moving parts in the real video and the simulator, before and after, replayed open loop."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from simtune.run.files import plain
from simtune.simulation import Simulator
from simtune.trajectory import seen_late
from simtune.vision.detections import Detections
from simtune.vision.keypoints import Keypoints

_MIN_SEEN_PROBABILITY = 0.5  # of a detection: with less, a keypoint counts as unseen
_END_SHARE = 0.1  # of an episode
_MAX_ERROR_PX, _LOST_PICTURES = 2.0, 3  # a part is lost when off by more, in so many pictures


@dataclass(frozen=True)
class MovingParts:
    """L keypoints in an episode's T + 1 pictures, in pixels; NaN if unknown."""

    parts: tuple[str, ...]  # (L,) body of each
    detected: np.ndarray  # (T + 1, L, 2)
    before: np.ndarray  # simulated, with the same actions
    after: np.ndarray

    def distances(self) -> dict[str, dict[str, np.ndarray]]:
        """{part: {"before", "after": (T + 1,) pixels from its detection}}."""
        found = {}
        for part in dict.fromkeys(self.parts):
            of_part = np.array(self.parts) == part
            found[part] = {
                "before": _distance(self.before[:, of_part], self.detected[:, of_part]),
                "after": _distance(self.after[:, of_part], self.detected[:, of_part]),
            }
        return found

    def scores(self) -> dict[str, dict[str, Any]]:
        """{part: medians of that, over the episode and its end, and how long it is within 2 px}.

        Medians, since a detector occasionally fails. In pixels, and pictures; JSON.
        """
        found = {}
        for part, curves in self.distances().items():
            last = max(1, round(_END_SHARE * len(curves["after"])))
            figures = {
                f"{figure}{when}": value
                for when, key in (("_before", "before"), ("", "after"))
                for figure, value in (
                    ("px", _median(curves[key])),
                    ("end_px", _median(curves[key][-last:])),
                    ("pictures_along", _along(curves[key])),
                )
            }
            found[part] = plain(figures)
        return found

    def to_json(self) -> dict[str, Any]:
        films = {"detected": self.detected, "before": self.before, "after": self.after}
        rounded = {name: np.round(film, 2).tolist() for name, film in films.items()}
        return plain({"parts": list(self.parts), **rounded})

    @classmethod
    def from_json(cls, known: dict[str, Any]) -> "MovingParts":
        """The inverse. Raises KeyError, TypeError or ValueError for anything else."""
        parts = tuple(map(str, known["parts"]))
        films = [np.array(known[name], float) for name in ("detected", "before", "after")]
        if any(film.ndim != 3 or film.shape[1:] != (len(parts), 2) for film in films):
            raise ValueError(f"{len(parts)} keypoints of shapes {[its.shape for its in films]}")
        steps = min(map(len, films))
        return cls(parts, *(film[:steps] for film in films))


def part_name(model: mujoco.MjModel, body: int) -> str:
    """What a moving body is called in results."""
    return model.body(body).name or f"body {body}"


def follow_parts(
    simulator: Simulator,
    keypoints: Keypoints,
    detections: Detections,
    actions: np.ndarray,
    start: np.ndarray,
    parameters: tuple[np.ndarray, np.ndarray],
    late_steps: float = 0.0,
) -> MovingParts:
    """Parts in an episode of (T, A) actions from the state `start` (S,).

    `detections`: in its T + 1 real pictures; `parameters`: (N,) before and after; `late_steps`: by
    which pictures are late.
    """
    model = simulator.model
    bodies = model.body_weldid[model.geom_bodyid[keypoints.geoms]].tolist()
    played = simulator.roll_out(
        np.stack(parameters),
        np.repeat(actions[None].astype(float), 2, 0),
        np.random.default_rng(0),  # not used: the start is given
        keypoints.observe,
        starts=np.repeat(start[None], 2, 0),
        keep_diverged=True,
    )
    seen = seen_late(played.observed, late_steps)
    before, after = seen.reshape(2, len(actions) + 1, len(keypoints), 2)
    is_sure = detections.probability[:, 0] >= _MIN_SEEN_PROBABILITY
    return MovingParts(
        tuple(part_name(model, body) for body in bodies),
        np.where(is_sure[..., None], detections.keypoints, np.nan),
        before,
        after,
    )


def _distance(simulated: np.ndarray, detected: np.ndarray) -> np.ndarray:
    """(T + 1,) root mean square over the detected of a part's (T + 1, K, 2) keypoints, or NaN."""
    squared = np.square(simulated - detected).sum(-1)
    seen = np.isfinite(squared)
    total = np.where(seen, squared, 0.0).sum(1)
    return np.where(seen.any(1), np.sqrt(total / np.maximum(seen.sum(1), 1)), np.nan)


def _median(distances: np.ndarray) -> float:
    known = distances[np.isfinite(distances)]
    return float(np.median(known)) if len(known) else np.nan


def _along(distances: np.ndarray) -> int | None:
    """Pictures before the one from which on the part is lost, of all. None: never lost.

    It is lost where it is off in `_LOST_PICTURES` one after the other, of those that show it.
    """
    known = np.flatnonzero(np.isfinite(distances))
    off = distances[known] > _MAX_ERROR_PX
    runs = [i for i in range(len(off) - _LOST_PICTURES + 1) if off[i : i + _LOST_PICTURES].all()]
    return int(known[runs[0]]) if runs else None
