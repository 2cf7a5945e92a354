"""Commands before any run: what there is, whether it works, and recordings."""

import math

from simtune.cli.commands import DoctorCommand, ExampleCommand, TasksCommand
from simtune.cli.outcome import CommandResult, PrintLine, quoted
from simtune.columns import counted
from simtune.config import CheckConfig, RecordConfig


def doctor(_: DoctorCommand, print_line: PrintLine) -> CommandResult:
    from simtune.doctor import analyze, works

    found = {}
    for name, words in analyze():
        found[name] = words
        print_line(f"{name:10s} {words}")
    failure = "" if works(found) else "the default renderer does not work here; see above"
    return CommandResult(found, failure)


def tasks(_: TasksCommand, print_line: PrintLine) -> CommandResult:
    from simtune.tasks import TASKS, load_task

    result = {}
    for name in TASKS:
        task = load_task(name)
        print_line(f"{name}: {task.description} ({task.step_s:g} s a step)")
        for p in task.parameters:
            unit = "" if p.unit == "1" else p.unit
            span = f"{p.nominal:<8.4g} in [{p.low:.4g}, {p.high:.4g}] {unit}"
            print_line(f"  {p.name:18s} {span:36s} {p.field} of {', '.join(p.objects)}")
        for sensor in task.sensors:
            print_line(f"  --observe cameras,joints also reads {', '.join(sensor.joints)}")
        keys = ("unit", "nominal", "low", "high", "field", "objects")
        result[name] = {
            "description": task.description,
            "step_s": task.step_s,
            "parameters": {p.name: {key: getattr(p, key) for key in keys} for p in task.parameters},
        }
    return CommandResult(result)


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
    from simtune.progress import ProgressBar
    from simtune.record import record

    with ProgressBar() as progress:
        folder = record(config, progress)
    count = counted(config.episodes, "episode")
    checked = f"{quoted(config.task)} --real {quoted(folder)}"
    print_line(f"{count} in {folder}; next: simtune check {checked}")
    return CommandResult({"recordings": str(folder), "episodes": config.episodes})
