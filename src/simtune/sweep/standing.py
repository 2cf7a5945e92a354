"""The state of a run of a sweep, read from its own folder and from notes of its failures."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from simtune.run.files import read_json, write_json
from simtune.run.stored import read_result
from simtune.sweep.asked import AskedRun

_MOST_KILLS = 20  # by a signal, e.g. for lack of memory, which is rarely the run's own fault
_SCORES = (
    "percent_error",
    "return",
    "success",
    "near_success",
    "real_episodes",
    "policy_steps",
    "sim_steps",
    "wall_s",
    "stopped",
)


@dataclass(frozen=True, kw_only=True)
class Standing:
    """State of one run."""

    status: Literal["done", "failed", "waiting"]
    failures: int = 0
    kills: int = 0
    reason: str | None = None  # of the last failure
    spent_s: float = 0.0  # wall time of its processes, as far as drivers saw their end
    scores: dict[str, Any] = field(default_factory=dict)

    def entry(self, run: AskedRun) -> dict[str, Any]:
        """The run's entry in sweep.json."""
        return {"name": run.name, "asked": run.asked, **asdict(self)}


@dataclass(frozen=True)
class Places:
    """Paths of a run's files. The sweep keeps its own files outside the run's folder."""

    folder: Path  # of the sweep
    name: str
    kind: Literal["runs", "pilots"] = "runs"

    @property
    def run(self) -> Path:
        return self.folder / self.kind / self.name

    @property
    def lease(self) -> Path:
        return self._beside("lock")

    @property
    def noted(self) -> Path:
        return self._beside("json")

    @property
    def log(self) -> Path:
        return self._beside("txt")

    def _beside(self, ending: str) -> Path:
        return self.folder / "state" / self.kind / f"{self.name}.{ending}"

    def make_folders(self) -> None:
        for path in (self.run, self.lease):
            path.parent.mkdir(parents=True, exist_ok=True)

    def standing(self, retries: int) -> Standing:
        """The run's state; it is done once it has a report, which is written last."""
        noted = self._read_noted()
        result = read_result(self.run)
        if result is not None and (self.run / "report.html").is_file():
            scores = {key: result[key] for key in _SCORES if key in result}
            return Standing(status="done", scores=scores, **noted)
        is_failed = noted["failures"] > retries or noted["kills"] > _MOST_KILLS
        return Standing(status="failed" if is_failed else "waiting", **noted)

    def note(
        self, spent_s: float, reason: str | None = None, *, killed: bool = False, failures: int = 1
    ) -> None:
        """Count one more attempt, and its failure if any. Only the lease's holder may call this.

        `failures`: what a failure counts as.
        """
        noted = self._read_noted()
        noted["spent_s"] += spent_s
        if reason is not None:
            noted["kills" if killed else "failures"] += 1 if killed else failures
            noted["reason"] = reason
        write_json(self.noted, noted)

    def forget(self) -> None:
        """Forget its attempts: the name means another run now."""
        self.noted.unlink(missing_ok=True)

    def _read_noted(self) -> dict[str, Any]:
        known = {"failures": 0, "kills": 0, "reason": None, "spent_s": 0.0}
        return known | (read_json(self.noted) if self.noted.exists() else {})
