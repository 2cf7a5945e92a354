"""The options of long-running commands, one dataclass each."""

from simtune.config.prints import Prints
from simtune.config.real import NO_RECORDINGS, ROBOTS, RealConfig, RecordingsConfig
from simtune.config.record import CompareConfig, ExportConfig, RecordConfig
from simtune.config.sweep import FiguresConfig, SweepConfig
from simtune.config.train import UNTUNED, EvaluateConfig, TrainConfig
from simtune.config.tune import CheckConfig, TuneConfig

__all__ = [
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
]
