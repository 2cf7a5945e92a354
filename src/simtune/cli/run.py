"""Runs each command and prints its results."""

import math
import shlex
import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from simtune.cli.commands import DoctorCommand, ExampleCommand, ReportCommand, TasksCommand
from simtune.config import (
    UNTUNED,
    CheckConfig,
    CompareConfig,
    EvaluateConfig,
    ExportConfig,
    FiguresConfig,
    RecordConfig,
    SweepConfig,
    TrainConfig,
    TuneConfig,
    check_paths,
)

Say = Callable[[str], None]  # prints a line
_NO_RECORDINGS = (
    "NO RECORDINGS ARE GIVEN, so this tunes to a simulated truth: --real DIR tunes to yours "
    "(docs/recordings.md)"
)


class Done(NamedTuple):
    """The outcome of a command."""

    result: dict[str, Any]  # printed by --json
    failure: str = ""


def check_first(command: Any) -> None:
    """Raises InputError for mistakes that show before torch is loaded, which takes seconds."""
    if hasattr(command, "check"):
        command.check()
    check_paths(command)
    if isinstance(command, CheckConfig | TuneConfig | TrainConfig | RecordConfig):
        from simtune.tasks import load_any_task

        load_any_task(command.task)


def run(command: Any, say: Say) -> Done:
    """Run a command; `say` gets the lines for people."""
    # Each command imports what it needs: torch and Warp take seconds, and --help should not.
    match command:
        case TasksCommand():
            return _tasks(say)
        case ExampleCommand():
            return _example(command, say)
        case CheckConfig():
            return _check(command, say)
        case TuneConfig():
            return _tune(command, say)
        case TrainConfig():
            return _train(command, say)
        case RecordConfig():
            return _record(command, say)
        case EvaluateConfig():
            from simtune.evaluation.evaluate import evaluate

            return Done(evaluate(command))
        case ExportConfig():
            return _export(command, say)
        case CompareConfig():
            return _compare(command, say)
        case ReportCommand():
            return _report(command, say)
        case SweepConfig():
            return _sweep(command, say)
        case FiguresConfig():
            from simtune.figures import write_figures

            page = write_figures(command.folder)
            say(str(page))
            return Done({"figures": str(page)})
        case DoctorCommand():
            return _doctor(say)
    raise AssertionError(f"no such command: {command}")


def _tasks(say: Say) -> Done:
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


def _example(command: ExampleCommand, say: Say) -> Done:
    from simtune.example import copy_example

    out = copy_example(command.name, command.out)
    prepare = out / "prepare.sh"
    prepared = f"{_quoted(prepare)}, then " if prepare.exists() else ""
    say(f"{out}; next: {prepared}simtune check {_quoted(out / 'tune.toml')}")
    return Done({"example": str(out)})


def _command() -> str:
    """The command line, as stored in result.json."""
    return shlex.join(["simtune", *sys.argv[1:]])


def _quoted(path: str | Path) -> str:
    """As a shell reads it."""
    return shlex.quote(str(path))


def _check(config: CheckConfig, say: Say) -> Done:
    from simtune.checking import carry_out
    from simtune.progress import ProgressBar

    # Only the search for a camera's pose has a time that is known beforehand.
    total_s = 60 * config.budget_minutes if config.camera_pose else math.inf
    with ProgressBar(total_s) as progress:
        result, lines = carry_out(config, progress)
    say("\n".join(lines))
    return Done(result)


def _tune(config: TuneConfig, say: Say) -> Done:
    from simtune.progress import ProgressBar
    from simtune.tuning_run import tune

    if not any(word.partition("=")[0] == "--real" for word in sys.argv):
        print(_NO_RECORDINGS, file=sys.stderr, flush=True)
    with ProgressBar(60 * config.budget_minutes) as progress:
        result = tune(config, progress, command=_command())
    return _say_result(result, config.out, say)


def _train(config: TrainConfig, say: Say) -> Done:
    from simtune.algorithm import train
    from simtune.progress import ProgressBar

    with ProgressBar() as progress:
        result = train(config, progress, command=_command())
    return _say_result(result, config.out, say)


def _say_result(result: dict[str, Any], out: Path, say: Say) -> Done:
    """Print the estimates if there are any, all warnings, and a policy's scores."""
    from simtune.api.table import lines
    from simtune.report.words import number

    if result["method"] not in UNTUNED:
        say("\n".join(lines(result["parameters"], result["search"])))
        if "percent_error" in result:
            say(f"mean error {result['percent_error']:.1f} %")
    for warning in result["warnings"]:
        say(f"warning: {warning}")
    if "return" in result:
        score = result["return"]
        scored = counted(score["episodes"], "episode")
        say(f"return {number(score['mean'])} ± {number(score['std'])} in {scored}")
    for goal in ("success", "near_success"):
        if goal in result:
            say(f"{goal.replace('_', ' ')} in {100 * result[goal]['mean']:.0f} % of them")
    report = str(out / "report.html")
    say(f"\nreport: {report}")
    return Done(result | {"report": report})


def _record(config: RecordConfig, say: Say) -> Done:
    from simtune.progress import ProgressBar
    from simtune.record import record

    with ProgressBar() as progress:
        folder = record(config, progress)
    count = counted(config.episodes, "episode")
    checked = f"{_quoted(config.task)} --real {_quoted(folder)}"
    say(f"{count} in {folder}; next: simtune check {checked}")
    return Done({"recordings": str(folder), "episodes": config.episodes})


def _export(config: ExportConfig, say: Say) -> Done:
    from simtune.export import export

    out = export(config)
    what = f"{out / 'model.xml'}, with its numbers in parameters.json and apply.py"
    what += ", and samples.csv" * bool(config.samples)
    what += f", and {config.format}_worlds.py" * (config.format != "samples")
    say(str(out) if config.is_file else what)
    files = [out] if config.is_file else sorted(path for path in out.rglob("*") if path.is_file())
    return Done({"files": [str(path) for path in files]})


def _compare(config: CompareConfig, say: Say) -> Done:
    from simtune.compare import compare, table

    result = compare(config)
    say("\n".join(table(result)))
    return Done(result)


def _report(command: ReportCommand, say: Say) -> Done:
    from simtune.report import write_report

    page = write_report(command.run_folder)
    say(str(page))
    result = {"report": str(page)}
    if command.rerun:
        from simtune.report.rerun_file import write_rerun

        write_rerun(command.run_folder, command.rerun)
        say(str(command.rerun))
        result["rerun"] = str(command.rerun)
    if command.open:
        webbrowser.open(page.resolve().as_uri())
    return Done(result)


def _sweep(config: SweepConfig, say: Say) -> Done:
    from simtune.sweep import dry_run, sweep

    if config.dry_run:
        return Done({"seconds_left": dry_run(config, say)})
    standings = sweep(config)
    result = {name: standing.status for name, standing in standings.items()}
    failed = [name for name, status in result.items() if status == "failed"]
    if failed:
        return Done(
            result,
            f"{len(failed)} of {counted(len(standings), 'run')} failed: {', '.join(failed)}; "
            f"{config.out / 'sweep.json'} has the reasons",
        )
    say(f"{counted(len(standings), 'run')} done; next: simtune figures {_quoted(config.out)}")
    return Done(result)


def _doctor(say: Say) -> Done:
    from simtune.doctor import analyze, works

    found = {}
    for name, words in analyze():
        found[name] = words
        say(f"{name:10s} {words}")
    failure = "" if works(found) else "the default renderer does not work here; see above"
    return Done(found, failure)


def counted(num: int, what: str) -> str:
    """A number with its noun: 1 round, 2 rounds."""
    return f"{num} {what}{'s' * (num != 1)}"
