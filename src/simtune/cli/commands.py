"""The commands and their options; options of long-running commands are in `simtune.config`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg, subcommand

from simtune.config import (
    CheckConfig,
    CompareConfig,
    EvaluateConfig,
    ExportConfig,
    FiguresConfig,
    Prints,
    RecordConfig,
    SweepConfig,
    TrainConfig,
    TuneConfig,
)


@dataclass(frozen=True)
class TasksCommand(Prints):
    """List the built-in tasks, or one task's parameters."""

    name: Annotated[Positional[str | None], arg(metavar="[NAME]")] = None
    """A built-in task or a tuning file, whose parameters are listed; by default all built-in tasks,
    a line each."""


@dataclass(frozen=True)
class ExampleCommand(Prints):
    """Copy an example to try and change: a tuning file, its model, and recordings if it has any."""

    name: Annotated[Positional[str], arg(metavar="NAME")]
    """cart_pendulum, phone_pendulum, bouncing_ball, servos, unitree_g1 or aloha."""
    out: Path = Path("examples")
    """The folder into which it is copied, as OUT/NAME."""


@dataclass(frozen=True)
class ReportCommand(Prints):
    """Write a run's report.html again."""

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune tune` or `simtune train` wrote."""
    open: bool = False
    """Show it in the browser."""
    rerun: Path | None = None
    """Also write a file NAME.rrd for the Rerun viewer: videos, joint readings and estimates over
    time. Needs rerun-sdk: pip install rerun-sdk."""


@dataclass(frozen=True)
class DoctorCommand(Prints):
    """Print what this machine has: versions, devices, working renderers."""


Command = (
    Annotated[TasksCommand, subcommand("tasks")]
    | Annotated[ExampleCommand, subcommand("example")]
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
