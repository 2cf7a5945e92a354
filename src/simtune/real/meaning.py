"""What a robot's episodes mean: they are used together only if they mean the same."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.robot.robot_file import RobotConfig
from simtune.run.files import plain, read_json
from simtune.tasks import AnyTask

Meaning = Mapping[str, Any]  # JSON; keys are names for messages


def meaning_of(config: RobotConfig, task: AnyTask) -> Meaning:
    """What gives episodes of a task their meaning, on the robot of a file.

    The tuning file's whole content counts: with it, what stands before the camera may have changed.
    """
    playback = config.camera.playback
    return plain(
        {
            "actions.moved": config.moved,
            "actions.step": config.step,
            "axes": config.axes,
            "start": config.start,
            "camera": [config.camera.name, playback and playback.name],
            "control_timestep_s": task.step_s,
            "content of the task": task.content_hash,
        }
    )


def check_meaning(dataset: Path, noted: Path, now: Meaning) -> None:
    """Raise InputError unless a dataset, by its file `noted`, means what new episodes would."""
    try:
        then = read_json(noted)
    except (OSError, ValueError):
        then = None
    if then == now:
        return
    if not isinstance(then, dict):
        raise InputError(
            f"{noted} is missing or damaged, and nothing else says what {dataset} means: give "
            f"another --out to film anew; --real {dataset} uses it as recordings"
        )
    others = ", ".join(key for key in {**now, **then} if then.get(key) != now.get(key))
    raise InputError(
        f"{dataset} was filmed with another {others}, so its episodes and new ones do not go "
        "together: change that back to go on with them, or give another --out to film anew; "
        f"--real {dataset} uses them as recordings"
    )
