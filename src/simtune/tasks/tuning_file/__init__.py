"""A user's own model as a task, declared in TOML (docs/tuning-file.md)."""

from simtune.tasks.tuning_file.load import load_tuning_file
from simtune.tasks.tuning_file.named_files import named_files

__all__ = ["load_tuning_file", "named_files"]
