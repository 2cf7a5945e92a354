"""Runs each command, by the function of its name.

These import what they need within: torch and Warp take seconds, and --help should not.
"""

from collections.abc import Callable
from typing import Any

from simtune.cli import before_runs, of_runs
from simtune.cli.commands import DoctorCommand, ExampleCommand, ReportCommand, TasksCommand
from simtune.cli.done import Done, Say
from simtune.config import (
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

_COMMANDS: dict[type, Callable[[Any, Say], Done]] = {
    TasksCommand: before_runs.tasks,
    ExampleCommand: before_runs.example,
    CheckConfig: before_runs.check,
    TuneConfig: of_runs.tune,
    TrainConfig: of_runs.train,
    RecordConfig: before_runs.record,
    EvaluateConfig: of_runs.evaluate,
    ExportConfig: of_runs.export,
    CompareConfig: of_runs.compare,
    ReportCommand: of_runs.report,
    SweepConfig: of_runs.sweep,
    FiguresConfig: of_runs.figures,
    DoctorCommand: before_runs.doctor,
}


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
    return _COMMANDS[type(command)](command, say)
