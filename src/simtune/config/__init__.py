"""What commands are asked: one dataclass a command that runs for long."""

from simtune.config.record import RecordConfig, RendererName
from simtune.config.train import EvaluateConfig, Method, TrainConfig
from simtune.config.tune import CheckConfig, SearchName, TuneConfig

__all__ = [
    "CheckConfig",
    "EvaluateConfig",
    "Method",
    "RecordConfig",
    "RendererName",
    "SearchName",
    "TrainConfig",
    "TuneConfig",
]
