"""Comparison of observations with the simulator, before and after: videos, parts, readings."""

from typing import Any

from simtune.before_after.moving_parts import MovingParts, follow_parts
from simtune.before_after.readings import Replayed, Tuned, replay
from simtune.before_after.start_search import episode_and_start
from simtune.before_after.videos import write_videos
from simtune.experiment.experiment import Experiment
from simtune.run.folder import RunFolder
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import Estimate
from simtune.vision.keypoints import Keypoints


def write_before_after(
    experiment: Experiment, folder: RunFolder, found: Estimate, real: list[Trajectory]
) -> dict[str, Any]:
    """Write videos and replay.json of the first real episode; returns their part of result.json."""
    facts, curves = {}, {}
    if real[0].readings:
        replayed = _replay(experiment, found, real)
        facts["sensors"], curves = replayed.scores(), replayed.curves()
    if real[0].has_pictures and (parts := _film(experiment, folder, found, real[0])):
        facts["moving_parts"] = parts.scores()
        curves |= {"step_s": real[0].step_s, "keypoints": parts.to_json()}
    if curves:
        folder.write_replay(curves)
    return facts


def _film(
    experiment: Experiment, folder: RunFolder, found: Estimate, real: Trajectory
) -> MovingParts | None:
    """Write the videos of the episode whose initial state the estimate holds.

    Returns the parts that move in them, if there is a detector for keypoints.
    """
    simulator, keypoints = experiment.simulator, experiment.keypoints
    seed, config = experiment.config.seed, experiment.settings.start_search
    late, start = episode_and_start(simulator, real, found, seed, config)
    parameters = experiment.start, found.mean
    late_steps = found.pictures_late_s[0] / real.step_s
    write_videos(folder.videos, simulator, late, start, parameters, late_steps)
    detections = experiment.search.detect(real.frames)
    if detections is None or not isinstance(keypoints, Keypoints) or not len(keypoints):
        return None
    assert isinstance(simulator, Simulator), "it has keypoints"
    return follow_parts(
        simulator, keypoints, detections, late.actions, start, parameters, late_steps
    )


def _replay(experiment: Experiment, found: Estimate, real: list[Trajectory]) -> Replayed:
    """Joint readings beside the simulator's."""
    context = experiment.context
    tuned = Tuned(found.mean, found.offsets, found.latency_steps, found.readings_late_s[0])
    return replay(context.simulator, context.observation, real, context.start, tuned)
