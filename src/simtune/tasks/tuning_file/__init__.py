"""A user's own model as a task, declared in a TOML file, without any Python."""

from simtune.tasks.tuning_file.load import load_tuning_file

__all__ = ["load_tuning_file"]
