"""Commands before any run: what there is, whether it works, and recordings."""

import math
from typing import TYPE_CHECKING, Any

from simtune.cli.commands import DoctorCommand, ExampleCommand, TasksCommand
from simtune.cli.outcome import CommandResult, PrintLine, quoted
from simtune.columns import aligned, counted, cut
from simtune.config import CheckConfig, RecordConfig

if TYPE_CHECKING:
    from simtune.tasks import AnyTask

_MOST_OBJECTS, _MOST_JOINTS = 3, 12  # that are named of a parameter, and of a task


def doctor(_: DoctorCommand, print_line: PrintLine) -> CommandResult:
    from simtune.doctor import NAMES, analyze, works

    found, width = {}, max(map(len, NAMES))
    for name, words in analyze():
        found[name] = words
        print_line(f"{name:{width}s}  {words}")
    failure = "" if works(found) else "the default renderer does not work here; see above"
    return CommandResult(found, failure)


def tasks(command: TasksCommand, print_line: PrintLine) -> CommandResult:
    from simtune.tasks import TASKS, load_any_task

    listed = [load_any_task(name) for name in ([command.name] if command.name else TASKS)]
    if command.name:
        print_line("\n".join(_in_full(listed[0])))
    else:
        width = max(len(task.name) for task in listed)
        for task in listed:
            count = counted(len(task.parameters), "parameter")
            print_line(f"{task.name:{width}s}  {task.description} ({count})")
        print_line("\nsimtune tasks NAME lists a task's parameters")
    return CommandResult({task.name: _in_json(task) for task in listed})


def _in_full(task: "AnyTask") -> list[str]:
    """A task with its parameters, a line each."""
    rows: list[tuple[str, ...]]
    rows = [("parameter", "nominal", "low", "high", "unit", "in the model")]
    for p in task.parameters:
        numbers = (f"{value:.4g}" for value in (p.nominal, p.low, p.high))
        unit = "" if p.unit == "1" else p.unit
        place = f"{p.field} of {cut(p.objects, _MOST_OBJECTS)}" if p.objects else p.field
        rows.append((p.name, *numbers, unit, place))
    head = f"{task.name}: {task.description} ({task.step_s:.4g} s a step)"
    lines = [head, "", *aligned(rows, left=(0, 4, 5))]
    if joints := [joint for sensor in getattr(task, "sensors", ()) for joint in sensor.joints]:
        asked = "--observe cameras,joints also " * bool(getattr(task, "looks_at", None))
        lines += ["", f"{asked}reads {cut(joints, _MOST_JOINTS)}"]
    return lines


def _in_json(task: "AnyTask") -> dict[str, Any]:
    keys = ("unit", "nominal", "low", "high", "field", "objects")
    return {
        "description": task.description,
        "step_s": task.step_s,
        "parameters": {p.name: {key: getattr(p, key) for key in keys} for p in task.parameters},
    }


def example(command: ExampleCommand, print_line: PrintLine) -> CommandResult:
    from simtune.example import copy_example

    out = copy_example(command.name, command.out)
    prepare = out / "prepare.sh"
    prepared = f"{quoted(prepare)}, then " if prepare.exists() else ""
    print_line(f"{out}; next: {prepared}simtune check {quoted(out / 'tune.toml')}")
    return CommandResult({"example": str(out)})


def check(config: CheckConfig, print_line: PrintLine) -> CommandResult:
    from simtune.checking import carry_out
    from simtune.progress import ProgressBar

    # Only the search for a camera's pose has a time that is known beforehand.
    total_s = 60 * config.budget_minutes if config.camera_pose else math.inf
    with ProgressBar(total_s) as progress:
        result, lines = carry_out(config, progress)
    print_line("\n".join(lines))
    return CommandResult(result)


def record(config: RecordConfig, print_line: PrintLine) -> CommandResult:
    from simtune.filming import record
    from simtune.progress import ProgressBar

    with ProgressBar() as progress:
        folder = record(config, progress)
    count = counted(config.episodes, "episode")
    checked = f"{quoted(config.task)} --real {quoted(folder)}"
    print_line(f"{count} in {folder}; next: simtune check {checked}")
    return CommandResult({"recordings": str(folder), "episodes": config.episodes})
