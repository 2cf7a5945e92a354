"""The command line: `simtune COMMAND --help` says what each takes."""

import contextlib
import io
import json
import os
import re
import shlex
import sys
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args

import tyro
from tyro.conf import Positional, arg, subcommand

import simtune
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
)
from simtune.errors import InputError, UnknownName


@dataclass(frozen=True)
class TasksCommand:
    """List the built-in tasks and their parameters."""


@dataclass(frozen=True)
class ReportCommand:
    """Write the report.html of a run anew."""

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune tune` or `simtune train` wrote."""
    open: bool = False
    """Show it in the browser."""
    rerun: Path | None = None
    """Write a file for the Rerun viewer, too, NAME.rrd: the videos, joint readings and estimates
    over time. Needs simtune[rerun]."""


@dataclass(frozen=True)
class DoctorCommand:
    """Say what this machine has: versions, devices, renderers that work."""


Command = (
    Annotated[TasksCommand, subcommand("tasks")]
    | Annotated[CheckConfig, subcommand("check")]
    | Annotated[TuneConfig, subcommand("tune")]
    | Annotated[TrainConfig, subcommand("train")]
    | Annotated[RecordConfig, subcommand("record")]
    | Annotated[EvaluateConfig, subcommand("evaluate")]
    | Annotated[ExportConfig, subcommand("export")]
    | Annotated[CompareConfig, subcommand("compare")]
    | Annotated[ReportCommand, subcommand("report")]
    | Annotated[SweepConfig, subcommand("sweep")]
    | Annotated[FiguresConfig, subcommand("figures")]
    | Annotated[DoctorCommand, subcommand("doctor")]
)


_TYPES = {"int": "a whole number", "float": "a number"}


def main() -> None:
    """Exit status: 0 done, 1 failed, 2 the input cannot be used (one line says why), 130 Ctrl-C."""
    # Before torch is loaded: threads that wait for each other by spinning make training five
    # times slower as soon as anything else runs on the machine.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    command = None
    try:
        if sys.argv[1:] == ["--version"]:
            print(f"simtune {simtune.__version__}")
        else:
            _run(command := _parse())
        sys.stdout.flush()
    except InputError as error:
        sys.exit(_complain(error, 2))
    except KeyboardInterrupt:
        sys.exit(_complain(_interrupted(command), 130))
    except BrokenPipeError:  # `simtune tasks | head -1`: the reader has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # or Python complains when it closes stdout
        sys.exit(1)
    except MemoryError as error:
        sys.exit(_complain(f"out of memory: {error}", 1))
    except (RuntimeError, OSError) as error:
        sys.exit(_complain(error, 1))


def _parse() -> Any:
    """The command with its options. Raises InputError in place of tyro's boxes of many lines."""
    known = [meta.name for c in get_args(Command) for meta in get_args(c)[1:]]
    if (given := sys.argv[1:2]) and not given[0].startswith("-") and given[0] not in known:
        raise UnknownName("command", given[0], "simtune", known)
    stderr = io.StringIO()
    try:
        with contextlib.redirect_stderr(stderr):
            config = (tyro.conf.DisallowNone,)  # what is optional is left out
            return tyro.cli(Command, prog="simtune", description=__doc__, config=config)  # type: ignore[arg-type]
    except SystemExit as exit_:
        if not exit_.code:
            raise
        lines = [line.strip("│ ") for line in stderr.getvalue().splitlines()]
        inside = [line for line in lines if line and line[0] not in "╭╰"]
        rule = next((i for i, line in enumerate(inside) if line[0] == "─"), len(inside))
        what = re.sub(r", 'None'|'None', ", "", " ".join(inside[:rule]).rstrip("."))
        if wrong := re.search(r"Error parsing (\S+): .*\b(int|float)\b.*: ('.*')", what):
            option, kind, value = wrong.groups()
            what = f"{option} must be {_TYPES[kind]}, got {value}"
        if other := re.search(r"(--[\w-]+) \(applied to (simtune \w+)\)", what):
            option, command = other.groups()
            what = f"{command} has no {option}"
        raise InputError(f"{what}; --help says what there is") from None


def _run(command: Any) -> None:
    if isinstance(command, CheckConfig | TuneConfig | TrainConfig | RecordConfig):
        from simtune.tasks import load_any_task

        command.check()  # before torch is loaded, which takes seconds
        load_any_task(command.task)
    # Each imports what it needs: torch and Warp take seconds, and --help should not.
    match command:
        case TasksCommand():
            _print_tasks()
        case CheckConfig():
            _check(command)
        case TuneConfig():
            _tune(command)
        case TrainConfig():
            _train(command)
        case RecordConfig():
            _record(command)
        case EvaluateConfig():
            from simtune.evaluate import evaluate

            print(json.dumps(evaluate(command)))
        case ExportConfig():
            from simtune.export import export

            out = export(command)
            what = f"{out / 'model.xml'}, with its numbers in parameters.json and apply.py"
            what += ", and samples.csv" * bool(command.samples)
            what += f", and {command.format}_worlds.py" * (command.format != "samples")
            print(out if command.is_file else what)
        case CompareConfig():
            _compare(command)
        case ReportCommand():
            from simtune.report import write_report

            page = write_report(command.run_folder)
            print(page)
            if command.rerun:
                from simtune.report.rerun_file import write_rerun

                write_rerun(command.run_folder, command.rerun)
                print(command.rerun)
            if command.open:
                webbrowser.open(page.resolve().as_uri())
        case SweepConfig():
            _sweep(command)
        case FiguresConfig():
            from simtune.figures import write_figures

            print(write_figures(command.folder))
        case DoctorCommand():
            from simtune.doctor import analyze

            if not analyze(print):
                raise RuntimeError("the default renderer does not work here; see above")


def _print_tasks() -> None:
    from simtune.tasks import TASKS, load_task

    for name in TASKS:
        task = load_task(name)
        print(f"{name}: {task.description} ({task.step_s:g} s a step)")
        for p in task.parameters:
            unit = "" if p.unit == "1" else p.unit
            span = f"{p.nominal:<8.4g} in [{p.low:.4g}, {p.high:.4g}] {unit}"
            print(f"  {p.name:18s} {span:36s} {p.field} of {', '.join(p.objects)}")


def _command() -> str:
    """What was typed, as result.json remembers it."""
    return shlex.join(["simtune", *sys.argv[1:]])


def _check(config: CheckConfig) -> None:
    from simtune.checking import check, table
    from simtune.progress import ProgressBar

    if config.camera_pose:
        _find_camera_pose(config)
        return
    with ProgressBar() as progress:
        result = check(config, progress)
    print(json.dumps(result) if config.json else "\n".join(table(result)))


def _find_camera_pose(config: CheckConfig) -> None:
    from simtune.camera_pose import find_camera_pose, lines
    from simtune.progress import ProgressBar

    with ProgressBar(60 * config.budget_minutes) as progress:
        result = find_camera_pose(config, progress)
    print(json.dumps(result) if config.json else "\n".join(lines(result, config.camera_pose)))


def _compare(config: CompareConfig) -> None:
    from simtune.compare import compare, table

    result = compare(config)
    print(json.dumps(result) if config.json else "\n".join(table(result)))


def _tune(config: TuneConfig) -> None:
    from simtune.progress import ProgressBar
    from simtune.tuning_run import tune

    with ProgressBar(60 * config.budget_minutes) as progress:
        result = tune(config, progress, command=_command())
    _print_result(result)
    print(f"\nreport: {config.out / 'report.html'}")


def _train(config: TrainConfig) -> None:
    from simtune.algorithm import train
    from simtune.progress import ProgressBar

    with ProgressBar() as progress:
        result = train(config, progress, command=_command())
    _print_result(result)
    if "return" in result:
        score = result["return"]
        scored = _counted(score["episodes"], "episode")
        print(f"return {score['mean']:.0f} ± {score['std']:.0f} in {scored}")
    for goal in ("success", "near_success"):
        if goal in result:
            print(f"{goal.replace('_', ' ')} in {100 * result[goal]['mean']:.0f} % of them")
    print(f"\nreport: {config.out / 'report.html'}")


def _record(config: RecordConfig) -> None:
    from simtune.progress import ProgressBar
    from simtune.record import record

    with ProgressBar() as progress:
        folder = record(config, progress)
    count = _counted(config.episodes, "episode")
    print(f"{count} in {folder}; next: simtune check {config.task} --real {folder}")


def _sweep(config: SweepConfig) -> None:
    from simtune.sweep import dry_run, sweep

    if config.dry_run:
        dry_run(config, print)
        return
    standings = sweep(config)
    failed = [name for name, standing in standings.items() if standing.status == "failed"]
    if failed:
        raise RuntimeError(
            f"{len(failed)} of {_counted(len(standings), 'run')} failed: {', '.join(failed)}; "
            f"{config.out / 'sweep.json'} has the reasons"
        )
    print(f"{_counted(len(standings), 'run')} done; next: simtune figures {config.out}")


def _counted(num: int, what: str) -> str:
    return f"{num} {what}{'s' * (num != 1)}"


def _interrupted(command: Any) -> str:
    """What of a run is kept."""
    if isinstance(command, SweepConfig):
        return "interrupted; the same command goes on"
    if not isinstance(command, TuneConfig | TrainConfig):
        return "interrupted"
    from simtune.run.folder import kept_state

    if not (state := kept_state(command.out)):
        return "interrupted before the first round was done: the same command begins it anew"
    kept = _counted(state["rounds"], "finished round")
    if isinstance(command, TrainConfig):
        kept += f" and {_counted(state['step'], 'step')} of the policy's training"
    return f"interrupted; kept: {kept}; what came later is lost, and the same command goes on there"


def _complain(what: object, status: int) -> int:
    print(f"simtune: {' '.join(str(what).split())}", file=sys.stderr)
    return status


def _print_result(result: dict) -> None:
    """A table of the estimates, where there are any, and all warnings."""
    from simtune.api.table import lines

    if result["method"] not in UNTUNED:
        print("\n".join(lines(result["parameters"])))
        if "percent_error" in result:
            print(f"mean error {result['percent_error']:.1f} %")
    for warning in result["warnings"]:
        print(f"warning: {warning}")
