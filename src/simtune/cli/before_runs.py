"""Commands before any run: what there is, whether it works, and recordings."""

import math

from simtune.cli.commands import DoctorCommand, ExampleCommand, TasksCommand
from simtune.cli.done import Done, Say, quoted
from simtune.columns import counted
from simtune.config import CheckConfig, RecordConfig


def doctor(_: DoctorCommand, say: Say) -> Done:
    from simtune.doctor import analyze, works

    found = {}
    for name, words in analyze():
        found[name] = words
        say(f"{name:10s} {words}")
    failure = "" if works(found) else "the default renderer does not work here; see above"
    return Done(found, failure)


def tasks(_: TasksCommand, say: Say) -> Done:
    from simtune.tasks import TASKS, load_task

    result = {}
    for name in TASKS:
        task = load_task(name)
        say(f"{name}: {task.description} ({task.step_s:g} s a step)")
        for p in task.parameters:
            unit = "" if p.unit == "1" else p.unit
            span = f"{p.nominal:<8.4g} in [{p.low:.4g}, {p.high:.4g}] {unit}"
            say(f"  {p.name:18s} {span:36s} {p.field} of {', '.join(p.objects)}")
        for sensor in task.sensors:
            say(f"  --observe cameras,joints also reads {', '.join(sensor.joints)}")
        keys = ("unit", "nominal", "low", "high", "field", "objects")
        result[name] = {
            "description": task.description,
            "step_s": task.step_s,
            "parameters": {p.name: {key: getattr(p, key) for key in keys} for p in task.parameters},
        }
    return Done(result)


def example(command: ExampleCommand, say: Say) -> Done:
    from simtune.example import copy_example

    out = copy_example(command.name, command.out)
    prepare = out / "prepare.sh"
    prepared = f"{quoted(prepare)}, then " if prepare.exists() else ""
    say(f"{out}; next: {prepared}simtune check {quoted(out / 'tune.toml')}")
    return Done({"example": str(out)})


def check(config: CheckConfig, say: Say) -> Done:
    from simtune.checking import carry_out
    from simtune.progress import ProgressBar

    # Only the search for a camera's pose has a time that is known beforehand.
    total_s = 60 * config.budget_minutes if config.camera_pose else math.inf
    with ProgressBar(total_s) as progress:
        result, lines = carry_out(config, progress)
    say("\n".join(lines))
    return Done(result)


def record(config: RecordConfig, say: Say) -> Done:
    from simtune.progress import ProgressBar
    from simtune.record import record

    with ProgressBar() as progress:
        folder = record(config, progress)
    count = counted(config.episodes, "episode")
    checked = f"{quoted(config.task)} --real {quoted(folder)}"
    say(f"{count} in {folder}; next: simtune check {checked}")
    return Done({"recordings": str(folder), "episodes": config.episodes})
