"""A user's own model as a task, declared in TOML (docs/tuning-file.md)."""

from simtune.tasks.tuning_file.load import load_tuning_file, read_task
from simtune.tasks.tuning_file.model import is_xml
from simtune.tasks.tuning_file.named_files import named_files
from simtune.tasks.tuning_file.toml_table import TomlTable

__all__ = ["TomlTable", "is_xml", "load_tuning_file", "named_files", "read_task"]
