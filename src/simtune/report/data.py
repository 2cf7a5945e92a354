"""What a run folder tells, read for a report; whatever is missing is left out."""

import zipfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from simtune.config import UNTUNED
from simtune.errors import InputError
from simtune.run import read_json, read_jsonl
from simtune.run.config import TIME_IS_OVER
from simtune.run.folder import POSTERIOR
from simtune.run.sources import changed_sources, source_of
from simtune.tasks import AnyTask, load_any_task
from simtune.validate import is_number

VIDEOS = ("real", "before", "after", "overlay")
POLICY_VIDEO = "policy"  # the same policy as is scored


class Estimate(NamedTuple):
    """What was known of a parameter after a round of the search."""

    round: float
    mean: float
    low: float  # 90 % interval
    high: float
    range_low: float  # the searched range
    range_high: float


class Posterior(NamedTuple):
    """What posterior.npz holds."""

    names: tuple[str, ...]
    draws: np.ndarray  # (num, N) in the parameters' units
    correlation: np.ndarray  # (N, N) of the copula


@dataclass(frozen=True, kw_only=True)
class RunData:
    """The content of a run folder."""

    path: Path
    config: dict[str, Any]
    stored: dict[str, Any]  # config.json whole: config, versions, created
    result: dict[str, Any]  # empty while the run goes on
    metrics: list[dict[str, Any]]
    events: list[dict[str, Any]]
    curves: dict[str, dict[str, list[float]]]
    posterior: Posterior | None
    videos: dict[str, bytes]  # mp4 files by name
    replay: dict[str, Any]  # the first episode's joint readings, empty where there are none

    def load_task(self) -> AnyTask:
        """What was tuned, from the copies that the run keeps, or else from the files themselves.

        Raises InputError where both are gone or have changed.
        """
        source = self.config["task"]
        kept = source_of(self.path, self.stored, source)
        with suppress(InputError):  # what it names by an absolute path is gone, say
            if self._is_mine(task := load_any_task(kept)):
                return task
        if source.endswith(".toml") and not Path(source).exists():
            raise InputError(
                f"{self.path} was made with {source}, which is not there: bring it back, or tune "
                "anew"
            )
        if not self._is_mine(task := load_any_task(source)):
            files = changed_sources(self.path, self.stored, source) or [source, "its model"]
            raise InputError(
                f"{' or '.join(files)} is not what {self.path} was made with: "
                "bring it back, or tune anew"
            )
        return task

    def _is_mine(self, task: AnyTask) -> bool:
        return self.config.get("task_content") == task.content_hash

    def get(self, key: str) -> Any:
        """A fact about the run: of the result, or else the last measurement, or the config."""
        for source in (self.result, self.metrics[-1] if self.metrics else {}, self.config):
            if source.get(key) is not None:
                return source[key]
        # A training counts the policy's steps instead.
        counts_steps = key == "sim_steps" and "policy_steps" not in self.config
        return self.metrics[-1].get("step") if counts_steps and self.metrics else None

    @property
    def title(self) -> str:
        """The task's name, or else the folder's."""
        known = (self.result.get("task"), self.config.get("task_name"), self.config.get("task"))
        return next(filter(None, known), self.path.resolve().name)

    def object(self, key: str) -> dict[str, Any]:
        """An object in the result; empty where there is none."""
        value = self.result.get(key)
        return value if isinstance(value, dict) else {}

    @property
    def readings(self) -> dict[str, dict[str, Any]]:
        """How well each joint reading is explained, by its label."""
        listed = self.object("sensors")
        return {name: facts for name, facts in listed.items() if isinstance(facts, dict)}

    @property
    def has_pictures(self) -> bool:
        """Whether a camera was looked at, as far as anything says; else it was readings alone."""
        recordings = self.object("recordings")
        if "cameras" in recordings:
            return bool(recordings["cameras"])
        return bool(self.videos) or not self.readings

    @property
    def evidence(self) -> str:
        """What parameters were told by."""
        return "videos" if self.has_pictures else "recordings"

    @property
    def is_out_of_time(self) -> bool:
        """Whether more time might have told more."""
        return self.result.get("stopped") == TIME_IS_OVER

    @property
    def is_tuned(self) -> bool:
        """Whether anything was searched for."""
        return self.get("method") not in UNTUNED

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """What is known of each parameter, by name; of a run that goes on, the last estimate."""
        if self.result.get("parameters"):
            return self.result["parameters"]
        declared = self.config.get("parameters")
        known = {**declared} if isinstance(declared, dict) else {}
        last = self.metrics[-1] if self.metrics else {}
        for name in (key.removeprefix("mean/") for key in last if key.startswith("mean/")):
            facts = known[name] if isinstance(known.get(name), dict) else {}
            known[name] = facts | {k: last.get(f"{k}/{name}") for k in ("mean", "low", "high")}
        return {name: facts for name, facts in known.items() if isinstance(facts, dict)}

    @property
    def colours(self) -> list[str]:
        """Names NAME of which NAME_r, NAME_g and NAME_b are all parameters."""
        channels = [name for name, facts in self.parameters.items() if _is_of_colour(facts)]
        names = (channel[:-2] for channel in channels if channel.endswith("_r"))
        return [name for name in names if {f"{name}_g", f"{name}_b"} <= set(channels)]

    def is_colour(self, name: str) -> bool:
        return name[:-2] in self.colours and name[-2:] in ("_r", "_g", "_b")

    def history(self, name: str) -> list[Estimate]:
        """The estimates of a parameter; lines that lack any of the figures are left out."""
        keys = ("round", *(f"{figure}/{name}" for figure in Estimate._fields[1:]))
        rows: list[list[Any]] = [[line.get(key) for key in keys] for line in self.metrics]
        return [Estimate(*row) for row in rows if all(map(is_number, row))]


def _is_of_colour(facts: dict[str, Any]) -> bool:
    """By its values: what is called r, g or b need not be one."""
    known = (facts.get(key) for key in ("nominal", "initial", "mean", "low", "high", "real"))
    return all(0 <= value <= 1 for value in known if is_number(value))


def read_run(path: Path) -> RunData:
    """Read a run folder. Raises InputError where `path` is none or its files are damaged."""
    if not (path / "config.json").is_file():
        what = "it has no config.json" if path.exists() else "there is no such folder"
        raise InputError(f"{path} is no run: {what}")
    stored = _read_object(path / "config.json")
    config = stored.get("config")
    videos = {name: path / "videos" / f"{name}.mp4" for name in (*VIDEOS, POLICY_VIDEO)}
    return RunData(
        path=path,
        config=config if isinstance(config, dict) else {},
        stored=stored,
        result=_read_object(path / "result.json"),
        metrics=read_jsonl(path / "metrics.jsonl"),
        events=read_jsonl(path / "events.jsonl"),
        curves=_read_object(path / "curves.json"),
        replay=_read_object(path / "replay.json"),
        posterior=_read_posterior(path / POSTERIOR),
        videos={name: file.read_bytes() for name, file in videos.items() if file.is_file()},
    )


def read_finished(path: Path) -> RunData:
    """The same of a run that has a result. Raises InputError for others."""
    run = read_run(path)
    if not run.result.get("parameters"):
        raise InputError(
            f"{path} has no result yet: let the run end, or, where it was interrupted, give its "
            "command once more"
        )
    return run


def _read_posterior(path: Path) -> Posterior | None:
    """None where there is no such file. Raises InputError."""
    if not path.exists():
        return None
    try:
        with np.load(path) as file:
            names, draws, correlation = (file[key] for key in Posterior._fields)
        if draws.ndim != 2 or draws.shape[1] != len(names) or not np.isfinite(draws).all():
            raise ValueError(f"draws of {len(names)} parameters have the shape {draws.shape}")
        if correlation.shape != (len(names),) * 2:
            raise ValueError(f"the correlation has the shape {correlation.shape}")
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is damaged: {error}") from None
    return Posterior(tuple(names.tolist()), draws, correlation)


def _read_object(path: Path) -> dict[str, Any]:
    """A JSON file's object, empty where there is no file. Raises InputError."""
    if not path.exists():
        return {}
    try:
        value = read_json(path)
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}") from None
    if not isinstance(value, dict):
        raise InputError(f"{path} is damaged: it holds no object")
    return value
