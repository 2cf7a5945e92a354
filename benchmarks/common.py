"""What benchmarks share. Run as a script it prints what every one's JSON says of the machine."""

import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch

from simtune.fit import FitConfig
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.tuning.posterior_config import PosteriorSearchConfig

# A search in seconds that finds nothing, to see that all of a benchmark runs.
QUICK = PosteriorSearchConfig(
    num_worlds=32,
    held_out_worlds=16,
    near_worlds=8,
    near_steps=8,
    detector_updates=(10,),
    posterior_updates=10,
    state_updates=10,
    least_updates=2,
    planned_refits=1,
    most_refits=1,
    fit=FitConfig(
        num_particles=8,
        shooting=ShootingConfig(stages=(Stage(4, 1, 2.0), Stage(8, 1)), longer=(), num_windows=6),
    ),
)

_ROOT = Path(__file__).parents[1]
_CODE = ("src", "benchmarks", "pyproject.toml", "constraints.txt")
_PACKAGES = ("simtune", "mujoco", "mujoco-warp", "warp-lang", "torch")


def machine(*more_packages: str) -> dict[str, Any]:
    """The hardware, and the versions of what the figures depend on."""
    return {
        "hardware": {"cpu": _cpu_model(), "cores": os.cpu_count()},
        "versions": {name: version(name) for name in (*_PACKAGES, *more_packages)},
    }


@contextmanager
def kept_in(out: Path, quick: bool) -> Iterator[Path]:
    """The folder for what is not run again; of a quick run one that goes away."""
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) if quick else out
        folder.mkdir(parents=True, exist_ok=True)
        yield folder


def record_figures(
    path: Path | None,
    key: Sequence[str],
    rows: Sequence[dict[str, Any]],
    columns: Mapping[str, str] | None = None,
) -> None:
    """Put figures into a claim's file in docs/results; nothing without a path.

    Each row gets the command, commit, date and hardware, unless it names them. It replaces the row
    with the same `key` fields but keeps what a benchmark does not measure, such as a goal. A new
    file has `columns`, {title: text}, or a plain one for each field; its title and text are then
    written by hand.
    """
    if path is None:
        return
    if path.exists():
        claim = json.loads(path.read_text(encoding="utf-8"))
    else:
        shown = columns or {name: f"{{{name}}}" for name in (rows[0] if rows else ())}
        claim = {"title": path.stem, "claim": "", "note": "", "key": list(key)}
        listed = [{"title": title, "text": text} for title, text in shown.items()]
        claim |= {"columns": listed, "rows": []}
    key, origin = claim["key"], _origin()
    by_key = {tuple(row[name] for name in key): row for row in claim["rows"]}
    for row in rows:
        same = tuple(row[name] for name in key)
        by_key[same] = by_key.get(same, {}) | origin | row
    claim["rows"] = list(by_key.values())
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(claim, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _origin() -> dict[str, str | None]:
    script = Path(sys.argv[0]).resolve()
    name = script.relative_to(_ROOT) if script.is_relative_to(_ROOT) else script.name
    return {
        "command": shlex.join(["python", str(name), *sys.argv[1:]]),
        "commit": commit(),
        "date": date.today().isoformat(),
        "hardware": _hardware(),
    }


def commit() -> str | None:
    """Of what is measured. Dirty only by code: figures just written do not count."""
    short = _git("rev-parse", "--short", "HEAD")
    return short and short + ("-dirty" if _git("status", "--porcelain", *_CODE) else "")


def _git(*arguments: str) -> str | None:
    """What git says; None where there is no git or no repository."""
    try:
        command = ["git", "-C", str(_ROOT), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def _hardware() -> str:
    cores = os.cpu_count()
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else cores
    parts = [_cpu_model(), f"{usable} of {cores} cores"]
    if torch.cuda.is_available():
        parts.append(torch.cuda.get_device_name())
    return ", ".join(parts)


def _cpu_model() -> str:
    try:
        with open("/proc/cpuinfo") as lines:
            return next(line.split(":")[1].strip() for line in lines if "model name" in line)
    except (OSError, StopIteration):
        return platform.processor()


if __name__ == "__main__":
    print(json.dumps(machine()))
