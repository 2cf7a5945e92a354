"""The options of long-running commands, one dataclass each."""

from simtune.config.check import CheckConfig
from simtune.config.compare import CompareConfig
from simtune.config.evaluate import EvaluateConfig
from simtune.config.export import ExportConfig
from simtune.config.paths import check_paths
from simtune.config.prints import Prints
from simtune.config.real import LARGEST_PX, NO_RECORDINGS, ROBOTS, RealConfig, RecordingsConfig
from simtune.config.record import RecordConfig
from simtune.config.sweep import FiguresConfig, SweepConfig
from simtune.config.train import UNTUNED, TrainConfig
from simtune.config.tune import TuneConfig
from simtune.config.types import check_types

__all__ = [
    "LARGEST_PX",
    "NO_RECORDINGS",
    "ROBOTS",
    "UNTUNED",
    "CheckConfig",
    "CompareConfig",
    "EvaluateConfig",
    "ExportConfig",
    "FiguresConfig",
    "Prints",
    "RealConfig",
    "RecordConfig",
    "RecordingsConfig",
    "SweepConfig",
    "TrainConfig",
    "TuneConfig",
    "check_paths",
    "check_types",
]
