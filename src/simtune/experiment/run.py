"""A run from opening its folder to its report, common to `tune` and `train`."""

import logging
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from simtune.columns import cut, significant
from simtune.experiment import outcome
from simtune.experiment.comparison import write_before_after
from simtune.experiment.experiment import Experiment
from simtune.progress import ReportProgress, silent
from simtune.random_streams import Purpose, stream
from simtune.report import write_report
from simtune.run.folder import RunFolder
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import Estimate, unsure
from simtune.tuning.joint import NUM_DRAWS, Joint
from simtune.tuning.search import Round

log = logging.getLogger(__name__)
_PARAMETERS_PER_LINE = 4


class Run:
    """An experiment carried out in a folder; a context manager, since the folder is locked.

    Its counts only grow, so that a run can resume from any of its checkpoints.
    """

    def __init__(
        self,
        experiment: Experiment,
        report: ReportProgress = silent,
        began_s: float | None = None,
    ):
        """`began_s`: when the session began, by the monotonic clock; None: now.

        Raises InputError if `config.out` cannot be written, or holds anything else.
        """
        self.experiment, self._report = experiment, report
        self.folder = RunFolder.create(
            experiment.config.out, experiment.run_config, experiment.sources
        )
        self.estimate = unsure(experiment.search.distribution, "not identifiable")
        self.num_rounds = 0  # of the search
        self.round_s = 0.0  # seconds of the last round
        self.step = 0  # simulated steps, the x axis of logs: all in `tune`, the policy's in `train`
        self.to_keep: dict[str, Any] = {}  # further JSON for checkpoints
        self._start_s = time.monotonic() if began_s is None else began_s
        self._counts = self._simulated()  # at the start of the present round

    def __enter__(self) -> "Run":
        return self

    def __exit__(self, *_: object) -> None:
        self.folder.close()

    @property
    def wall_s(self) -> float:
        """Seconds spent on the run, over all sessions, each from its beginning."""
        return time.monotonic() - self._start_s

    def resume(self) -> dict[str, Any] | None:
        """Continue from the newest valid checkpoint; returns its state, or None if there is none.

        Raises InputError for the checkpoint of another version.
        """
        if not (checkpoint := self.folder.load_checkpoint()):
            return None
        tensors, state = checkpoint
        self.experiment.load(tensors, state)
        simulator = self.experiment.simulator
        simulator.num_steps, simulator.num_diverged = state["sim_steps"], state["num_diverged"]
        self.step, self.num_rounds = state["step"], state["rounds"]
        self.round_s = state.get("round_s", 0.0)  # absent in older versions
        self.estimate = Estimate.from_json(state["estimate"])
        self._start_s -= state["wall_s"]
        self._counts = self._simulated()
        return state

    def save(self, **own: Any) -> None:
        """Write a checkpoint; `own`: JSON that `resume` returns to the caller."""
        self._counts = self._simulated()
        self._save(own)

    def save_within(self) -> None:
        """Write a checkpoint of an unfinished round, whose worlds will be simulated again."""
        self._save({"is_within": True})

    def _save(self, own: dict[str, Any]) -> None:
        state = self.experiment.state() | self.to_keep | own | self._counts
        state |= {"step": self.step, "rounds": self.num_rounds, "wall_s": self.wall_s}
        state |= {"round_s": self.round_s, "step_s": self.experiment.real.step_s}
        state |= {"estimate": self.estimate.to_json()}
        self.folder.save_checkpoint(self.experiment.tensors(), state)

    def _simulated(self) -> dict[str, int]:
        simulator = self.experiment.simulator
        return {"sim_steps": simulator.num_steps, "num_diverged": simulator.num_diverged}

    def log(self, num_real: int, scalars: Mapping[str, float]) -> None:
        """A line of metrics.jsonl; `num_real` real episodes are known by now."""
        self.folder.logs.log_metrics(self.step, num_real, self.wall_s, scalars)

    def log_round(self, found: Round, num_real: int) -> None:
        """Store a round's estimate, and log its results."""
        self.estimate = found.estimate
        self.num_rounds += 1
        for event in found.events:
            self.folder.logs.log_event(self.step, self.wall_s, asdict(event))
        estimates = outcome.scalars(self.experiment.search.distribution, found.estimate)
        self.log(num_real, {"round": self.num_rounds} | estimates | found.metrics)

    def log_early(self, early: Estimate) -> None:
        """Log an estimate of an unfinished round."""
        experiment = self.experiment
        estimates = outcome.scalars(experiment.search.distribution, early)
        self.log(len(experiment.recordings), estimates | {"is_early": 1.0})
        rows = zip(experiment.space, early.mean, strict=True)
        values = cut([f"{p.name} {significant(value)}" for p, value in rows], _PARAMETERS_PER_LINE)
        log.info("a first answer, how sure is not known yet: %s", values)

    def finish(
        self,
        real: list[Trajectory],
        metadata: Mapping[str, Any],
        warnings: list[str],
        command: str | None,
    ) -> dict[str, Any]:
        """Write result.json, the posterior, the comparison of `real`'s first episode, the report.

        `metadata`: content of result.json beyond what every run has. Returns all its content.
        """
        experiment = self.experiment
        metadata = self._metadata(len(real)) | dict(metadata)
        result = outcome.result(
            metadata, experiment.space, experiment.start, self.estimate, experiment.truth, command
        )
        result["warnings"] = list(dict.fromkeys(warnings + result["warnings"]))  # told once
        if real and experiment.search_name:
            self._report("filming the comparison", 1.0)
            result |= write_before_after(experiment, self.folder, self.estimate, real)
        # Last, so that a run that is killed here has a result still: an earlier session's.
        self.folder.write_curves(outcome.curves(self.estimate))
        if experiment.search_name:
            result |= self._write_posterior()
        self.folder.write_result(result)
        write_report(self.folder.path)
        return result

    def _write_posterior(self) -> dict[str, Any]:
        """Write posterior.npz; returns its part of result.json."""
        joint = Joint.of(self.estimate, self.experiment.space)
        draws = joint.draw(NUM_DRAWS, stream(self.experiment.config.seed, Purpose.POSTERIOR))
        self.folder.write_posterior(joint.space.names, draws, joint.correlation)
        return outcome.joint_posterior(joint, self.estimate, draws)

    def _metadata(self, num_real: int) -> dict[str, Any]:
        """The part of result.json on how its figures were obtained."""
        experiment = self.experiment
        metadata = {
            "task": experiment.task.name,
            "method": "regression" if experiment.search_name == "regression" else "autotune",
            "search": experiment.search_name,
            "seed": experiment.config.seed,
            "real": experiment.config.real,
            "real_episodes": num_real,
            "step_s": experiment.real.step_s,
            **self._simulated(),
            "wall_s": round(self.wall_s, 1),
        }
        recordings = experiment.real.facts
        return metadata | ({"recordings": recordings} if recordings else {})
