"""The task with a camera at an unknown pose, and what moves before it."""

from dataclasses import replace

import mujoco
import numpy as np

from simtune.cameras.footage import Footage
from simtune.config.camera_pose import CameraPoseOptions
from simtune.errors import InputError
from simtune.observation import ObservationModel, measured_places
from simtune.parameters import ParameterSpace, camera_pose, field_of_view
from simtune.parameters.backlash_joints import driven_through
from simtune.simulation import StateSpace
from simtune.tasks import Task
from simtune.trajectory import Trajectory
from simtune.vision.keypoints import ENDLESS, is_drawn, moves_before

_LARGEST_FOV_DEG = 170.0


def with_any_camera(task: Task, footage: Footage, options: CameraPoseOptions) -> Task:
    """The task with one camera, of which only pose and field of view are tuned.

    Raises InputError if no joints are measured, or a field of view that a lens or a region defines
    is to be searched.
    """
    if footage.lens and options.within_fov_deg:
        raise InputError(
            "--within-fov-deg goes with a camera without lens and region: they say what it sees"
        )
    if not task.sensors:
        raise InputError(
            "where a camera is can be told where joints are measured: declare [[sensors]] "
            "(docs/tuning-file.md), or of a built-in task say --observe cameras,joints; or have "
            "`simtune tune` find a camera_pose"
        )
    model = task.load_model()
    given = model.camera(footage.camera)
    x, y, z = map(float, given.pos)
    within_rad = float(np.radians(options.within_deg))
    camera = camera_pose(
        "camera", footage.camera, (x, y, z), within_m=options.within_m, within_rad=within_rad
    )
    if options.within_fov_deg:
        fovy = float(given.fovy[0])
        low = max(fovy - options.within_fov_deg, fovy / 4)
        high = min(fovy + options.within_fov_deg, _LARGEST_FOV_DEG)
        seen = field_of_view("camera_field_of_view", footage.camera, fovy)
        camera.append(replace(seen, low=low, high=high))
    return replace(task, parameters=ParameterSpace(camera), cameras=(footage,))


def has_outlines(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) bool: what a camera sees, without endless ground."""
    return is_drawn(model) & ~np.isin(model.geom_type, ENDLESS)


def unlocated_geoms(
    model: mujoco.MjModel, camera: str, observation: ObservationModel
) -> np.ndarray:
    """(ngeom,) bool: what may be anywhere before a camera, since a joint between is not measured.

    Such as a box on the table. A joint that moves the camera as well is not between.
    """
    is_measured = np.zeros(model.nq, bool)
    is_measured[measured_places(observation.sensors)] = True
    of_joints = np.split(is_measured, model.jnt_qposadr[1:])
    # Backlash that is not measured is taken to be at its middle.
    unknown = [
        joint
        for joint, places in enumerate(of_joints)
        if not places.all() and driven_through(model, joint) < 0
    ]
    behind = np.zeros((len(unknown), model.nbody), bool)  # bodies that each of these joints moves
    behind[np.arange(len(unknown)), model.jnt_bodyid[unknown]] = True
    for body in range(1, model.nbody):
        behind[:, body] |= behind[:, model.body_parentid[body]]
    own = model.cam_bodyid[model.camera(camera).id]
    return (behind != behind[:, [own]]).any(0)[model.geom_bodyid]


def robot_before(model: mujoco.MjModel, camera: str) -> np.ndarray:
    """(ngeom,) bool: the robot as a camera sees it: drawn, and not fixed to the camera.

    Raises InputError for a camera that turns by itself, or before which nothing moves.
    """
    given = model.camera(camera)
    if model.cam_mode[given.id] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value:
        raise InputError(
            f"camera {camera!r} follows what moves; --camera-pose finds cameras that are fixed to "
            'a body: expected mode="fixed"'
        )
    moves = has_outlines(model) & moves_before(model, given.id)
    if not moves.any():
        raise InputError(f"nothing that the model draws moves before camera {camera!r}")
    return moves


def measured_states(
    model: mujoco.MjModel,
    observation: ObservationModel,
    trajectories: list[Trajectory],
    full_state: np.ndarray,
) -> np.ndarray:
    """(F, S) full states at all frames of all episodes in turn, at rest.

    Unmeasured joints are as in `full_state`; missing readings are NaN.
    """
    space = StateSpace(model)
    at_rest = space.positions_and_velocities(full_state).copy()
    at_rest[model.nq :] = 0.0
    found = []
    for trajectory in trajectories:
        states = np.tile(at_rest, (len(trajectory) + 1, 1))
        for sensor in observation.sensors:
            if sensor.is_position:
                states[:, sensor.places] = trajectory.readings[sensor.name]
        found.append(space.with_positions_and_velocities(full_state, states))
    return np.concatenate(found)
