"""A run's videos, joint readings and estimates over time, for the Rerun viewer."""

from pathlib import Path
from typing import Any

import numpy as np

from simtune.errors import InputError
from simtune.report.joint_plots import curves_of
from simtune.report.part_plots import moving_parts
from simtune.run_data import VIDEOS, RunData, read_run
from simtune.validate import is_number


def write_rerun(run_folder: Path, path: Path) -> None:
    """Write `path`, NAME.rrd, from a run folder.

    Timeline `time`, the seconds of an episode: videos/real, before, after and overlay, with the
    detected and the simulated keypoints, and joints/READING/measured, before and after. Timeline
    `round`: estimates/PARAMETER/mean, low and high.
    Raises InputError if rerun-sdk is missing or the run is damaged.
    """
    run = read_run(run_folder)
    try:
        import rerun  # type: ignore[import-not-found]
    except ImportError:
        raise InputError("a Rerun file needs rerun-sdk: pip install rerun-sdk") from None
    stream = rerun.RecordingStream(f"simtune {run.title}")
    try:
        stream.save(path)
    except Exception as error:  # rerun has its own type
        raise InputError(f"cannot write {path}: {error}") from None
    _send_videos(rerun, stream, run)
    _send_keypoints(rerun, stream, run)
    for place, timeline, values in _curves(run):
        times = {("sequence" if timeline == "round" else "duration"): values[0]}
        stream.send_columns(
            place,
            indexes=[rerun.TimeColumn(timeline, **times)],
            columns=rerun.Scalars.columns(scalars=values[1]),
        )
    stream.flush()


def _send_videos(rerun: Any, stream: Any, run: RunData) -> None:
    for name in (name for name in VIDEOS if name in run.videos):
        video = rerun.AssetVideo(contents=run.videos[name], media_type="video/mp4")
        stream.log(f"videos/{name}", video, static=True)
        stamps_ns = video.read_frame_timestamps_nanos()
        stream.send_columns(
            f"videos/{name}",
            indexes=[rerun.TimeColumn("time", duration=1e-9 * stamps_ns)],
            columns=rerun.VideoFrameReference.columns_nanos(stamps_ns),
        )


def _send_keypoints(rerun: Any, stream: Any, run: RunData) -> None:
    parts, step_s = moving_parts(run), run.replay.get("step_s")
    if parts is None or not is_number(step_s):
        return
    films = {"real": parts.detected, "before": parts.before, "after": parts.after}
    for name, pixels in films.items():
        seen = np.isfinite(pixels).all(-1)  # (T + 1, L)
        labels = np.tile(parts.parts, (len(pixels), 1))[seen].tolist()
        points = rerun.Points2D.columns(positions=pixels[seen] + 0.5, labels=labels)
        times = rerun.TimeColumn("time", duration=step_s * np.arange(len(pixels)))
        stream.send_columns(
            f"videos/{name}/keypoints",
            indexes=[times],
            columns=points.partition(seen.sum(1)),
        )


def _curves(run: RunData) -> list[tuple[str, str, tuple[np.ndarray, np.ndarray]]]:
    """(path, timeline, (times or rounds (T,), values (T,))) of all curves that are not empty."""
    curves = []
    for label in run.readings:
        for kind, values in curves_of(run, label).items():
            times_s = np.arange(len(values)) * float(run.replay["step_s"])
            curves.append((f"joints/{label}/{kind}", "time", (times_s, values)))
    for name in run.parameters:
        history = run.history(name)
        rounds = np.array([int(estimate.round) for estimate in history])
        for figure in ("mean", "low", "high"):
            values = np.array([getattr(estimate, figure) for estimate in history])
            curves.append((f"estimates/{name}/{figure}", "round", (rounds, values)))
    return [curve for curve in curves if len(curve[2][1])]
