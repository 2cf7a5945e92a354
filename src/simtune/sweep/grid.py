"""Reads GRID.toml: the runs are the product of each block's lists (docs/sweeps.md)."""

import itertools
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.sweep.asked import COMMANDS, AskedRun, check_name, short
from simtune.sweep.contents import check_options
from simtune.tasks import AnyTask, load_any_task
from simtune.toml_reading import TomlTable, read_toml

_PLAIN = r"[\w.=+-]"  # in the name of a folder
_LONGEST = 200
_OF_BLOCK = ("name", "command", "skip")  # every other key is an option of the command


def read_grid(file: Path) -> list[AskedRun]:
    """All runs of a file, lowest seeds first, so that a part of the sweep is balanced.

    Raises InputError, with the line, if the file cannot be read, or for options that the commands
    themselves would refuse.
    """
    table = read_toml(file)
    table.allow("options", "runs")
    usual, found = table.table("options"), dict[str, AskedRun]()
    blocks = table.tables("runs")
    if not blocks:
        raise table.error("it asks for no runs: declare some after a line [[runs]]")
    for block in blocks:
        for run in _multiplied(block, usual):
            other = found.setdefault(run.name, run).asked
            if other != run.asked:
                keys = sorted({key for key, _ in other.items() ^ run.asked.items()})
                raise block.error(
                    f"two runs would be called {run.name}, of another {', '.join(keys)}: put "
                    "them into two blocks, and give one of their blocks a name"
                )
    return sorted(found.values(), key=lambda run: run.seed)


def _multiplied(block: TomlTable, usual: TomlTable) -> Iterator[AskedRun]:
    """The runs of a block, with checks; `usual`: options of all blocks. Raises InputError."""
    command = block.choice("command", COMMANDS)
    options = _options(usual, command) | _options(block, command, _OF_BLOCK)
    if "task" not in options:
        raise block.error("task is missing: a built-in task, a tuning file, or a list of them")
    axes = [value if isinstance(value, list) else [value] for value in options.values()]
    varied = [name for name, value in options.items() if isinstance(value, list)]
    skips = [{key: skip.value(key) for key in skip} for skip in block.tables("skip")]
    for skip in skips:
        if unknown := [key for key in skip if key not in options]:
            raise block.error(f"skip asks for {unknown[0]}, which no run of this block has", "skip")
    combined = [dict(zip(options, values, strict=True)) for values in itertools.product(*axes)]
    for skip in skips:
        if not any(skip.items() <= chosen.items() for chosen in combined):
            raise block.error(f"no run of this block has what skip asks for: {skip}", "skip")
    asked = [c for c in combined if not any(skip.items() <= c.items() for skip in skips)]
    if not asked:
        raise block.error("it asks for no runs: a list is empty, or skip leaves none")
    tasks = dict[str, AnyTask]()
    for chosen in asked:
        with block.at():
            folder = block.file.parent
            name = _name(block.text("name", ""), command, chosen, varied, folder)
            run = AskedRun(name=name, command=command, options=chosen, folder=folder)
            config, source = run.config(), run.values["task"]
            if source not in tasks:
                tasks[source] = load_any_task(source)
            check_options(config, tasks[source])
        yield run


def _options(table: TomlTable, command: str, besides: Sequence[str] = ()) -> dict[str, Any]:
    """A table's options, all keys but `besides`. Raises InputError for what `command` has not."""
    found = {key: table.value(key) for key in table if key not in besides}
    for key in found:
        with table.at(key):
            check_name(command, key)
    return found


def _name(
    block: str, command: str, options: dict[str, Any], varied: list[str], folder: Path
) -> str:
    """Name of a run's folder, from its task, method and varied options. Raises InputError."""
    values = {name: _plain(short(value, folder)) for name, value in options.items()}
    parts = [block, values["task"], options.get("method", command)]
    others = [name for name in varied if name not in ("task", "method", "seed")]
    parts += [f"{name}={values[name]}" for name in others]
    parts.append(f"s{options.get('seed', 0)}")
    name = "-".join(str(part) for part in parts if part)
    if not re.fullmatch(rf"{_PLAIN}{{1,{_LONGEST}}}", name):
        raise InputError(
            f"{name} can be no folder's name: give the block a name of letters, digits and _.=+- "
            f"only, and keep all within {_LONGEST} characters"
        )
    return name


def _plain(text: str) -> str:
    """A text without what does not suit a file's name: 5% is 5, a/b is a_b."""
    return "_".join(re.findall(f"{_PLAIN}+", text))
