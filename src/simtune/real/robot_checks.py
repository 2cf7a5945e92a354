"""Whether a task's camera and actions are ones that a robot has."""

import logging
import math
from dataclasses import replace

import numpy as np

from simtune.cameras.footage import Footage
from simtune.errors import InputError
from simtune.robot.robot_file import RobotConfig
from simtune.simulation import MocapActions
from simtune.simulation.actions import ActionSpace
from simtune.tasks import AnyTask

log = logging.getLogger(__name__)
_SHORTEST_STEP_S = 0.1  # time of three pictures


def footage_of(task: AnyTask) -> Footage:
    """What the robot's camera films. Raises InputError if it is not one camera, used as it is."""
    if len(task.cameras) != 1:
        raise InputError(
            f"{task.name} has {len(task.cameras)} cameras; a robot is filmed by one: leave the "
            "other [[cameras]] out, or record it yourself and give the recordings"
        )
    footage = replace(task.cameras[0], key=None)  # the robot's recordings have one camera only
    if footage.lens:
        raise InputError(
            f"{task.name} has a lens or a region, and a robot's camera is used as it is: the "
            "square in the middle of its picture. Leave them out, give that square's "
            "field_of_view_deg, or record it yourself and give the recordings"
        )
    return footage


def check_actions(config: RobotConfig, task: AnyTask, mapping: ActionSpace) -> None:
    """Raises InputError if the task's actions are not displacements that the robot can take.

    Warns if they are too fast for it.
    """
    if len(config.moved) != len(mapping.names):
        raise InputError(
            f"{config.file}: {task.name} takes {len(mapping.names)} actions "
            f"({', '.join(mapping.names)}), 'moved' names {len(config.moved)}"
        )
    if task.step_s < _SHORTEST_STEP_S:
        raise InputError(
            f"{task.name} takes a step every {task.step_s:g} s; a camera needs at least "
            f"{_SHORTEST_STEP_S:g} s"
        )
    if not mapping.is_relative:
        raise InputError(
            f"an action of {task.name} is a control, and a robot's a displacement: have the "
            'tuning file say mapping = "mocap" or "joints" (docs/tuning-file.md)'
        )
    _check_displacements(config, mapping, task.step_s)


def _check_displacements(config: RobotConfig, mapping: ActionSpace, step_s: float) -> None:
    """Raises InputError if an xArm goes farther or less far than in the task; warns if it is slow.

    Other robots' units are unknown.
    """
    if config.driver == "xarm" and isinstance(mapping, MocapActions):
        its_mm = 1000 * mapping.metres_per_unit
        if not math.isclose(config.step, its_mm, rel_tol=1e-6):
            raise InputError(
                f"{config.file}: step = {config.step:g} mm, and the task's metres_per_unit is "
                f"{mapping.metres_per_unit:g}: expected step = {its_mm:g}"
            )
    # All actions at their largest, along the diagonal
    farthest = config.step * float(np.linalg.norm(np.abs(mapping.range).max(1)))
    if farthest > config.speed * step_s * (1 + 1e-9):
        log.warning(
            "%s: with speed = %g the robot goes %.3g within a step of %.3g s, and the task's "
            "actions go up to %.3g, which is shortened. Tuning uses what was sent, but a policy is "
            "trained with all of it: give a speed above %.3g, or a smaller step here and in the "
            "task",
            config.file,
            config.speed,
            config.speed * step_s,
            step_s,
            farthest,
            farthest / step_s,
        )
