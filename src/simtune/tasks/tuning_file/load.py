"""Reads a tuning file: a user's model as a task (docs/tuning-file.md)."""

from simtune.simulation import count_substeps
from simtune.tasks.environment_task import EnvironmentTask
from simtune.tasks.task import MOST_STEPS, Task
from simtune.tasks.tuning_file.actions import read_actions, read_columns
from simtune.tasks.tuning_file.camera import add_cameras
from simtune.tasks.tuning_file.environment import read_environment_task
from simtune.tasks.tuning_file.initial_state import read_initial_state
from simtune.tasks.tuning_file.model import model_name, read_model
from simtune.tasks.tuning_file.of_built_in import read_built_in
from simtune.tasks.tuning_file.parameters import read_known_colours, read_parameters
from simtune.tasks.tuning_file.policy import read_policy
from simtune.tasks.tuning_file.sensors import read_sensors
from simtune.toml_reading import TomlTable, usual_name

_KEYS = ("model", "name", "description", "camera", "cameras", "control_timestep_s", "action_repeat")
_KEYS += ("episode_steps", "fixed_joints", "fixed_pose", "actuators", "actions", "initial_state")
_KEYS += ("policy", "parameters", "sensors", "backlash")
_MOST_SUBSTEPS = 2000
_MOST_FINER = 100  # times, physics steps than the model's


def read_task(file: TomlTable) -> Task | EnvironmentTask:
    """The task that a file, or a dict with the same keys, declares.

    Of a model, an environment or a built-in task.

    Raises InputError "FILE:LINE: ..." if the file is invalid or does not fit its model.
    """
    if "environment" in file:
        return read_environment_task(file)
    if "task" in file:
        return read_built_in(file)
    file.allow(*_KEYS)
    nominal = read_model(file)
    footage = add_cameras(file, nominal)
    model, load_spec = nominal.compile(), nominal.copy
    control_timestep_s = file.number("control_timestep_s", above=0)
    action_repeat = file.whole("action_repeat", 1)
    step_s = control_timestep_s * action_repeat
    _check_step(file, step_s, model.opt.timestep)
    episode_steps = file.whole("episode_steps", 200, most=MOST_STEPS)
    actions = file.table("actions")
    map_actions = read_actions(actions, model)
    parameters = read_parameters(file, load_spec(), [f.camera for f in footage], step_s)
    return Task(
        name=file.text("name", usual_name(file.file)),
        description=file.text("description", f"{model_name(file)}, of {file.file.name}"),
        declared=file.content(without="policy") + "".join(f.content() for f in footage),
        load_spec=load_spec,
        parameters=parameters,
        known_colours=read_known_colours(file, parameters),
        cameras=footage,
        sensors=read_sensors(file, model),
        control_timestep_s=control_timestep_s,
        action_repeat=action_repeat,
        episode_steps=episode_steps,
        initialize=read_initial_state(file.table("initial_state"), model),
        map_actions=map_actions,
        action_columns=read_columns(actions, map_actions, model),
        **read_policy(file.table("policy"), model, episode_steps),
    )


def _check_step(file: TomlTable, step_s: float, timestep_s: float) -> None:
    """Raises InputError for an action that lasts far longer or less than a physics step."""
    if (count := count_substeps(step_s, timestep_s)) > _MOST_SUBSTEPS:
        raise file.error(
            f"an action would last {step_s:g} s, {count} physics steps of "
            f"{timestep_s:g} s; expected at most {_MOST_SUBSTEPS}; is it in seconds?",
            "control_timestep_s",
        )
    if step_s < timestep_s / _MOST_FINER:
        raise file.error(
            f"an action would last {step_s:g} s, much less than a physics step of "
            f"{timestep_s:g} s; is it in seconds?",
            "control_timestep_s",
        )
