"""The content of a run folder; what is missing is left out."""

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simtune.config import NO_RECORDINGS, UNTUNED
from simtune.errors import InputError
from simtune.names import DEFAULT_SEARCH, search_traits
from simtune.run.config import TIME_IS_OVER
from simtune.run.sources import changed_sources, other_readers, source_of
from simtune.validate import is_number

if TYPE_CHECKING:
    from simtune.tasks import AnyTask  # and MuJoCo, a second that who only compares runs saves


VIDEOS = ("real", "before", "after", "overlay", "unexplained")
POLICY_VIDEO = "policy"  # of the policy that is scored


class RoundEstimate(NamedTuple):
    """Estimate of a parameter after a round of the search."""

    round: float
    mean: float
    low: float  # 90 % interval, if the search gives one
    high: float
    range_low: float  # the searched range
    range_high: float


class Posterior(NamedTuple):
    """Content of posterior.npz."""

    names: tuple[str, ...]
    draws: np.ndarray  # (num, N) in the parameters' units
    correlation: np.ndarray  # (N, N) of the copula


@dataclass(frozen=True, kw_only=True)
class RunFacts:
    """What the files of a run folder say."""

    path: Path
    config: dict[str, Any]
    stored: dict[str, Any]  # all of config.json: config, versions, created
    result: dict[str, Any]  # empty until the run ends
    metrics: list[dict[str, Any]]
    events: list[dict[str, Any]]
    curves: dict[str, dict[str, list[float]]]
    posterior: Posterior | None
    replay: dict[str, Any]  # one episode's joint readings; empty if there are none

    @cached_property
    def videos(self) -> dict[str, bytes]:
        """Its mp4 files by name."""
        files = {name: self.path / "videos" / f"{name}.mp4" for name in (*VIDEOS, POLICY_VIDEO)}
        return {name: file.read_bytes() for name, file in files.items() if file.is_file()}

    def load_task(self) -> "AnyTask":
        """The tuned task, from the copies that the run keeps, or else from the original files.

        Raises InputError if both are gone or have changed, or other versions read them otherwise.
        """
        from simtune.tasks import load_any_task

        source = self.config["task"]
        kept = source_of(self.path, self.stored, source)
        with suppress(InputError):  # e.g. a file that it names by an absolute path is gone
            if self._is_mine(task := load_any_task(kept)):
                return task
        files = changed_sources(self.path, self.stored, source)
        readers = "" if files else other_readers(self.path, self.stored)
        is_gone = source.endswith(".toml") and not Path(source).exists()
        if is_gone and not readers:
            raise InputError(
                f"{self.path} was made with {source}, which is not there: bring it back, or tune "
                "anew"
            )
        if not is_gone and self._is_mine(task := load_any_task(source)):
            return task
        if readers:
            raise InputError(
                f"{source} is read otherwise than when {self.path} was made ({readers}): go back "
                "to the former versions, or tune anew"
            )
        raise InputError(
            f"{' or '.join(files or [source, 'its model'])} is not what {self.path} was made with: "
            "bring it back, or tune anew"
        )

    def _is_mine(self, task: "AnyTask") -> bool:
        return self.config.get("task_content") == task.content_hash

    def get(self, key: str) -> Any:
        """A fact from the result, or else from the last line of metrics, or the config."""
        for source in (self.result, self.metrics[-1] if self.metrics else {}, self.config):
            if source.get(key) is not None:
                return source[key]
        # In a training, "step" counts the policy's steps instead.
        counts_steps = key == "sim_steps" and "policy_steps" not in self.config
        return self.metrics[-1].get("step") if counts_steps and self.metrics else None

    @property
    def title(self) -> str:
        """The task's name, or else the folder's name."""
        known = (self.result.get("task"), self.config.get("task_name"), self.config.get("task"))
        return next(filter(None, known), self.path.resolve().name)

    def object(self, key: str) -> dict[str, Any]:
        """An object in the result; empty if there is none."""
        value = self.result.get(key)
        return value if isinstance(value, dict) else {}

    @property
    def readings(self) -> dict[str, dict[str, Any]]:
        """{label: how well the joint reading is explained}."""
        listed = self.object("sensors")
        return {name: facts for name, facts in listed.items() if isinstance(facts, dict)}

    @property
    def has_pictures(self) -> bool:
        """Whether the run used pictures, as far as known; otherwise it used readings only."""
        recordings = self.object("recordings")
        if "cameras" in recordings:
            return bool(recordings["cameras"])
        return bool(self.videos) or not self.readings

    @property
    def evidence(self) -> str:
        """The data from which parameters were estimated, in a word."""
        return "videos" if self.has_pictures else "recordings"

    @property
    def is_out_of_time(self) -> bool:
        """Whether the run ended because its time was over."""
        return self.result.get("stopped") == TIME_IS_OVER

    @property
    def films_anew(self) -> bool:
        """Whether a training films again with what it has learnt; the latest then come first."""
        return "policy_steps" in self.config and self.config.get("real") in NO_RECORDINGS

    @property
    def is_tuned(self) -> bool:
        """Whether the run searched for parameters."""
        return self.get("method") not in UNTUNED

    @property
    def search(self) -> str | None:
        """How the run searched for parameters; None if it did not."""
        if not self.is_tuned:
            return None
        # A training that goes on has it as its method.
        is_baseline = self.get("method") == "regression"
        return "regression" if is_baseline else self.get("search") or DEFAULT_SEARCH

    @property
    def has_intervals(self) -> bool:
        """Whether low and high are an interval's ends; otherwise they are the searched range's."""
        return search_traits(self.search).has_intervals

    @property
    def is_fitted(self) -> bool:
        """Whether motion was fitted, as far as known; in an environment it is not."""
        return not self.result or bool(self.object("ranks") or self.object("held_out"))

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """{name: facts} of each parameter; for a run that is still going, the last estimates."""
        if self.result.get("parameters"):
            return self.result["parameters"]
        declared = self.config.get("parameters")
        known = {**declared} if isinstance(declared, dict) else {}
        # In a training, lines about the policy follow those of a round.
        rounds = (line for line in reversed(self.metrics) if any(map(_is_mean, line)))
        last = next(rounds, {})
        for name in (key.removeprefix("mean/") for key in filter(_is_mean, last)):
            facts = known[name] if isinstance(known.get(name), dict) else {}
            known[name] = facts | {k: last.get(f"{k}/{name}") for k in ("mean", "low", "high")}
        return {name: facts for name, facts in known.items() if isinstance(facts, dict)}

    def survival_curves(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """{name: (values (C,), P(truth > value) (C,))}. Raises InputError if damaged."""
        try:
            return {
                name: (np.array(curve["candidates"], float), np.array(curve["prob_higher"], float))
                for name, curve in self.curves.items()
            }
        except (KeyError, TypeError, ValueError) as error:
            what = f"{type(error).__name__}: {error}"
            raise InputError(f"{self.path / 'curves.json'} is damaged: {what}") from None

    def history(self, name: str) -> list[RoundEstimate]:
        """A parameter's estimates over rounds; incomplete lines of metrics are left out."""
        keys = ("round", *(f"{figure}/{name}" for figure in RoundEstimate._fields[1:]))
        rows: list[list[Any]] = [[line.get(key) for key in keys] for line in self.metrics]
        return [RoundEstimate(*row) for row in rows if all(map(is_number, row))]


def _is_mean(key: str) -> bool:
    return key.startswith("mean/")
