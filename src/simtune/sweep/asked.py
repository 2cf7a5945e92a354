"""A run that a grid asks for: its name, options, and command line."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from os.path import expanduser
from pathlib import Path
from typing import Any

from simtune.config import NO_RECORDINGS, TrainConfig, TuneConfig, check_paths, check_types
from simtune.errors import UnknownName
from simtune.toml_reading import usual_name

COMMANDS = {"tune": TuneConfig, "train": TrainConfig}
_PATHS = ("robot", "real_parameters")
_OWN = ("out", "json")  # of a run, which the sweep decides


@dataclass(frozen=True, kw_only=True)
class AskedRun:
    name: str  # of its folder
    command: str  # one of COMMANDS
    options: Mapping[str, Any]  # as in the grid, including the task
    folder: Path  # the grid's folder, to which paths in `options` are relative; ~ is the home

    @property
    def asked(self) -> dict[str, Any]:
        """Command and options, stored in sweep.json: a name must always mean the same run."""
        return {"command": self.command, **self.options}

    @property
    def task(self) -> str:
        """The task's name: a tuning file's is that of the file, or of its folder."""
        return short(self.options["task"], self.folder)

    @property
    def seed(self) -> int:
        return self.options.get("seed", 0)

    @property
    def kind(self) -> str:
        """Command and options except the seed; runs of one kind take about the same time."""
        options = {k: v for k, v in self.asked.items() if k != "seed"}
        return " ".join(f"{k}={v}" for k, v in options.items())

    @cached_property
    def values(self) -> dict[str, Any]:
        """The options, with absolute paths of files and folders."""
        return {name: self._found(name, value) for name, value in self.options.items()}

    def _found(self, name: str, value: Any) -> Any:
        is_path = name in _PATHS
        is_path |= name == "task" and str(value).endswith(".toml")
        is_path |= name == "real" and value not in NO_RECORDINGS
        return str((self.folder / expanduser(str(value))).resolve()) if is_path else value

    def config(self) -> TuneConfig | TrainConfig:
        """The command's config. Raises InputError for options that the command would refuse."""
        kind = COMMANDS[self.command]
        check_types(kind, self.options)
        paths = {name: Path(self.values[name]) for name in _PATHS if name in self.values}
        config = kind(**self.values | paths, out=Path(self.name))
        config.check()
        check_paths(config)
        return config

    def arguments(self, out: Path) -> list[str]:
        """Arguments after `simtune`, for a run in the folder `out`."""
        typed = [self.command, self.values["task"], "--out", str(out.resolve())]
        for name, value in self.values.items():
            flag = name.replace("_", "-")
            if isinstance(value, bool):
                typed.append(f"--{flag}" if value else f"--no-{flag}")
            elif name != "task":
                typed += [f"--{flag}", str(value)]
        return typed


def check_name(command: str, name: str) -> None:
    """Raises UnknownName for a name that is no option of a sweep's `command`."""
    known = [field.name for field in fields(COMMANDS[command]) if field.name not in _OWN]
    if name not in known:
        raise UnknownName("option", name, f"simtune {command}", known)


def short(value: Any, folder: Path) -> str:
    """An option's value in few words; of a file, which `value` names from `folder`, its name."""
    text = str(value)
    if text.endswith(".toml"):
        return usual_name(folder / expanduser(text))
    return Path(text).stem if text.endswith(".json") else text
