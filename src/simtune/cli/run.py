"""Runs each command, by the function of its name.

These import what they need within: torch and Warp take seconds, and --help should not.
"""

from collections.abc import Callable
from typing import Any

from simtune.cli import run_commands, setup_commands
from simtune.cli.commands import DoctorCommand, ExampleCommand, ReportCommand, TasksCommand
from simtune.cli.outcome import CommandResult, PrintLine
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

_COMMANDS: dict[type, Callable[[Any, PrintLine], CommandResult]] = {
    TasksCommand: setup_commands.tasks,
    ExampleCommand: setup_commands.example,
    CheckConfig: setup_commands.check,
    RecordConfig: setup_commands.record,
    TuneConfig: run_commands.tune,
    TrainConfig: run_commands.train,
    EvaluateConfig: run_commands.evaluate,
    ExportConfig: run_commands.export,
    CompareConfig: run_commands.compare,
    ReportCommand: run_commands.report,
    SweepConfig: run_commands.sweep,
    FiguresConfig: run_commands.figures,
    DoctorCommand: setup_commands.doctor,
}


def check_first(command: Any) -> None:
    """Raises InputError for mistakes that show before torch is loaded, which takes seconds."""
    if hasattr(command, "check"):
        command.check()
    check_paths(command)
    if isinstance(command, CheckConfig | TuneConfig | TrainConfig | RecordConfig):
        from simtune.tasks import load_any_task

        load_any_task(command.task)


def run(command: Any, print_line: PrintLine) -> CommandResult:
    """Run a command; `print_line` gets the lines for people."""
    return _COMMANDS[type(command)](command, print_line)
