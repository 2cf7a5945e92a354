"""Whether what a task's sensors and cameras tell can be written, and read back as it was."""

from simtune.errors import InputError
from simtune.recordings.lerobot.layout import STATE
from simtune.tasks import Task


def check_written(task: Task) -> None:
    """Raises InputError for what could not be written, or would be read back otherwise."""
    if not task.load_actions().names:
        raise InputError(
            f"{task.name} has no actions, and a LeRobotDataset needs some: give the model actuators"
        )
    late = [part.name for part in (*task.cameras, *task.sensors) if part.latency_s]
    if late:
        raise InputError(
            f"{late[0]} of {task.name} has a latency_s, and what simtune films is in time: record "
            "with a copy of the tuning file without it"
        )
    _check_columns(task)


def _check_columns(task: Task) -> None:
    """Raises InputError if a reading would not be found again by its column's name."""
    names = [name for sensor in task.sensors for name in sensor.column_names]
    if doubled := [name for i, name in enumerate(names) if name in names[:i]]:
        raise InputError(
            f"two sensors of {task.name} would both be written as {doubled[0]!r}; name their "
            "columns one by one: columns = [...]"
        )
    for i, name in enumerate(names):
        if name.startswith(f"{STATE}[") and name != f"{STATE}[{i}]":
            raise InputError(
                f"{name!r} of {task.name} would be written as number {i} of {STATE!r}; list the "
                "columns in their order, from 0 on, or give them names"
            )
    for sensor in task.sensors:
        first = sensor.columns[0]
        reads_all = len(sensor.columns) == 1 and (sensor.size > 1 or first == STATE)
        if reads_all and (first != STATE or len(task.sensors) > 1):
            raise InputError(
                f"sensor {sensor.name} of {task.name} reads all of {first!r}, and simtune writes "
                f"all sensors side by side into {STATE!r}; name their columns one by one"
            )
