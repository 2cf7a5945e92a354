"""TOML files as tables whose errors name file and line."""

from simtune.toml_reading.table import LocatedError, TomlTable, read_toml, usual_name

__all__ = ["LocatedError", "TomlTable", "read_toml", "usual_name"]
