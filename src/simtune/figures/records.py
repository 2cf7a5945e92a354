"""Reads what figures need of finished runs, from run folders only."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.names import DEFAULT_SEARCH
from simtune.parameters.accuracy import FLOOR, percent_error
from simtune.run.files import read_json, read_jsonl
from simtune.run.stored import read_object
from simtune.tasks import TASKS
from simtune.validate import is_number

# Options that may differ between seeds of a group, that make groups otherwise, or that follow from
# other options
_NO_CONDITIONS = ("task", "out", "seed", "method", "search", "device", "move", "robot")
_NO_CONDITIONS += ("real_parameters", "task_name", "json")


@dataclass(frozen=True, kw_only=True)
class FinishedRun:
    """A run with a result."""

    name: str
    config: Mapping[str, Any]
    result: Mapping[str, Any]
    metrics: list[dict[str, Any]] = field(repr=False)

    @property
    def task(self) -> str:
        """The task's name; a user's own that is named like a built-in one is told from it."""
        name = str(self.result["task"])
        is_own = name in TASKS and self.config.get("task", name) != name
        return f"{name} (own)" if is_own else name

    @property
    def method(self) -> str:
        """The method of a training, or "tune"; with the search, unless it is the default one."""
        search, method = self.config.get("search"), self.config.get("method", "tune")
        return method if search in (None, DEFAULT_SEARCH) else f"{method}, {search}"

    @property
    def is_training(self) -> bool:
        return "method" in self.config

    @property
    def options(self) -> dict[str, Any]:
        """Options by which runs of one method may differ, without derived ones.

        Only options that are set, since earlier versions did not have all of them.
        """
        is_set = {k: v is not None and v is not False for k, v in self.config.items()}
        plain = {k: v for k, v in self.config.items() if is_set[k] and not isinstance(v, dict)}
        derived = ("_content", "truth")
        names = [k for k in plain if k not in _NO_CONDITIONS and not k.endswith(derived)]
        return {name: plain[name] for name in names}

    def score(self, name: str) -> float | None:
        """The mean of "return", "success", ... over scored episodes, or a plain number; None."""
        value = self.result.get(name)
        value = value.get("mean") if isinstance(value, dict) else value
        return value if is_number(value) else None

    def returns(self) -> list[tuple[float, float]]:
        """(policy steps, return in simulation) of episodes played on pictures."""
        played = [line for line in self.metrics if line.get("filmed")]
        return _points(played, "step", "return/simulated")

    def scores(self, against: str, score: str) -> list[tuple[float, float]]:
        """(`against`, score in the pseudo-real world) during the run, and at its end."""
        points = _points(self.metrics, against, f"{score}/real")
        at = self.result.get("policy_steps" if against == "step" else against)
        last = self.score(score)
        if is_number(at) and last is not None:
            points = [(x, y) for x, y in points if x < at] + [(float(at), last)]
        return points

    def percent_errors(self) -> list[tuple[float, float]]:
        """(real episodes, mean percent error) at the start and after each round.

        Without parameters that have no such error: a truth of 0 whose bounds nobody knows.
        """
        known = {n: p["real"] for n, p in self.result["parameters"].items() if "real" in p}
        truths = {n: real for n, real in known.items() if real or self._farthest_bound(n)}
        if not truths:
            return []
        start = {n: p["initial"] for n, p in self.result["parameters"].items()}
        rounds = [
            (float(line["real_episodes"]), {n: line.get(f"mean/{n}") for n in truths})
            for line in self.metrics
            if "round" in line
        ]
        reals, bounds = list(truths.values()), [self._farthest_bound(n) for n in truths]

        def mean_error(means: Mapping[str, Any]) -> float:
            errors = percent_error([means[n] for n in truths], reals, bounds)
            return sum(errors.tolist()) / len(truths)

        return [
            (num, mean_error(means))
            for num, means in [(0.0, start), *rounds]
            if all(is_number(means[n]) for n in truths)
        ]

    def _farthest_bound(self, name: str) -> float:
        """The bound that is farther from 0, or what a result without bounds was scored with.

        0 if nobody knows.
        """
        if name in self._bounds:
            return self._bounds[name]
        facts = self.result["parameters"][name]
        scored = facts.get("percent_error")
        off = abs(facts["mean"] - facts["real"])
        return 100 * off / scored / FLOOR if is_number(scored) and scored > 0 else 0.0

    @cached_property
    def _bounds(self) -> dict[str, float]:
        """{name: the bound that is farther from 0}, as far as the result has them."""
        covariance = self.result.get("covariance") or {}
        axes = covariance.get("coordinates", ())
        return {axis["name"]: max(abs(axis["low"]), abs(axis["high"])) for axis in axes}


def _points(lines: list[dict[str, Any]], x: str, y: str) -> list[tuple[float, float]]:
    pairs = [(line.get(x), line.get(y)) for line in lines]
    return [(float(a), float(b)) for a, b in pairs if is_number(a) and is_number(b)]


def read_records(folder: Path) -> tuple[list[FinishedRun], list[str]]:
    """All finished runs in a folder, at any depth, and the names of runs without a result.

    A sweep's pilots are skipped. Raises InputError if there are no runs, or one is damaged.
    """
    finished, unfinished, seen = [], [], set[Path]()
    for path, folders, files in os.walk(folder, followlinks=True):
        if (real := Path(path).resolve()) in seen:  # by a link
            folders.clear()
            continue
        seen.add(real)
        folders[:] = sorted(name for name in folders if name not in ("pilots", "checkpoints"))
        if "config.json" in files:
            folders.clear()
            record = _read(Path(path), folder)
            (finished if record else unfinished).append(record or Path(path).name)
    if (board := folder / "sweep.json").is_file():  # runs that failed before they had a config
        drawn = {Path(record.name).name for record in finished}
        unfinished += [name for name in _not_done(board) if name not in drawn]
    unfinished = list(dict.fromkeys(unfinished))
    if not finished:
        raise InputError(f"{folder} has no run with a result in it, so there is nothing to draw")
    return finished, unfinished


def _not_done(board: Path) -> list[str]:
    """Names of a sweep's runs that its sweep.json calls unfinished. Raises InputError."""
    try:
        return [e["name"] for e in read_json(board)["runs"] if e["status"] != "done"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{board} is damaged: {type(error).__name__}: {error}") from None


def _read(path: Path, folder: Path) -> FinishedRun | None:
    config = read_object(path / "config.json").get("config")
    if not isinstance(config, dict):
        raise InputError(f"{path} is damaged: its config.json has no options of a run")
    if not (path / "result.json").is_file():
        return None
    result = read_object(path / "result.json")
    if not {"task", "parameters"} <= result.keys():
        raise InputError(f"{path} is damaged: its result.json is none of a run")
    metrics = read_jsonl(path / "metrics.jsonl")
    name = str(path.relative_to(folder))
    return FinishedRun(name=name, config=config, result=result, metrics=metrics)
