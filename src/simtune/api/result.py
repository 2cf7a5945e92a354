"""A run's result as an object."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from numbers import Integral
from os import PathLike
from os.path import expanduser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from simtune.api import table
from simtune.api.estimate import ParameterEstimate, ParameterEstimates
from simtune.api.on_runs import Recordings, Values, compare_runs, evaluate_run
from simtune.api.plot import plot_curves, plot_estimates, plot_pairs
from simtune.api.shown import Shown
from simtune.api.spelling import in_python
from simtune.config import EvaluateConfig, ExportConfig, check_types
from simtune.errors import InputError, UnknownName
from simtune.export import draw_samples, export, tuned_model
from simtune.names import ExportFormat
from simtune.report.words import interval_label
from simtune.run_data import RunData
from simtune.tasks import with_model
from simtune.threads import wait_passively

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found]
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from simtune.api.policy import Policy

GOALS = ("success", "near_success")  # that a policy may reach
_PLOTTED_DRAWS = 500  # more would only fill the plot


class Result:
    """Result of a run; `simtune.load` reads it from any finished run's folder."""

    def __init__(self, run: RunData):
        self._run = run

    @property
    def path(self) -> Path:
        """The run's folder, which also has report.html."""
        return self._run.path

    @property
    def task(self) -> str:
        """The task's name."""
        return self.content["task"]

    @property
    def content(self) -> dict[str, Any]:
        """The content of result.json (docs/architecture.md, "The run folder")."""
        return self._run.result

    @property
    def warnings(self) -> list[str]:
        """Reasons to doubt the result, one sentence each."""
        return list(self.content.get("warnings", ()))

    @cached_property
    def parameters(self) -> dict[str, ParameterEstimate]:
        """{name: estimate}, in the order of arrays such as `covariance`."""
        shown = "\n".join(table.lines(self._run)), table.html(self._run)
        return ParameterEstimates(self._run.parameters, str(self.path), *shown)

    @property
    def score(self) -> dict[str, Any]:
        """What the policy of a training reached in its pseudo-real world.

        `mean` and `std` of its return, in `episodes` episodes; the same of each goal that the task
        has, such as `success`. Raises ValueError for a run without a policy, or whose world cannot
        be played: `evaluate(parameters=...)` scores a policy in another one.
        """
        content = self.content
        if "return" not in content:
            why = "its world cannot be played: evaluate(parameters=...) scores it in another one"
            why = why if "policy_steps" in content else "it has no policy"
            raise InputError(f"{self.path} has no score: {why}")
        return content["return"] | {name: content[name] for name in GOALS if name in content}

    @property
    def covariance(self) -> np.ndarray:
        """(N, N) in unit coordinates: from 0 at a parameter's low bound to 1 at its high bound.

        `content["covariance"]` has the parameters' scales and bounds. Raises ValueError for a run
        without a search.
        """
        if not (found := self._run.object("covariance")):
            raise InputError(f"{self.path} has no covariance: nothing was searched for there")
        return np.array(found["matrix"], float)

    def samples(self, num: int = 1000) -> dict[str, np.ndarray]:
        """Draws from the joint posterior: {name: (num,) values in its unit}.

        Every call returns the same draws; `np.column_stack(list(samples.values()))` is (num, N). Up
        to 4000 are read from posterior.npz; for more, all are drawn anew, which needs the task's
        files. Raises ValueError for a run without a search.
        """
        if not isinstance(num, Integral) or num < 1:
            raise InputError(f"num must be a whole number of at least 1, got {num}")
        if not self._run.is_tuned:
            raise InputError(f"{self.path} has no samples: nothing was searched for there")
        known = self._run.posterior
        if known is not None and num <= len(known.draws):
            names, draws = known.names, known.draws[:num].copy()
        else:
            space = self._run.load_task().parameters
            names, draws = space.names, draw_samples(self._run, space, num)
        return dict(zip(names, draws.T, strict=True))

    def model(self) -> mujoco.MjModel:
        """The task's model with the estimates, as the run simulated it.

        Raises ValueError if the task's files are gone or changed, or have no MuJoCo model.
        """
        task = with_model(self._run.load_task())
        mean = np.array([self.parameters[name].mean for name in task.parameters.names])
        return tuned_model(task, mean, self.content.get("step_s"))[1]

    def export(
        self,
        out: str | PathLike[str],
        samples: int | None = None,
        format: ExportFormat = "samples",
    ) -> Path:
        """Write the files of `simtune export` into the new folder `out`; returns the folder.

        These are model.xml, parameters.json and apply.py; with `samples` draws of the posterior
        also samples.csv, and worlds.npz and a module for the training library `format`.
        """
        options = {"out": Path(expanduser(out)), "samples": samples, "format": format}
        with in_python():
            check_types(ExportConfig, options)
            return export(ExportConfig(run_folder=self.path, **options))

    def policy(self) -> "Policy":
        """The policy of a run of `train`. Raises ValueError if there is none, or files changed."""
        wait_passively()
        from simtune.api.policy import Policy  # slow to load: it acts by torch

        with in_python():
            return Policy(self.path)

    def compare(self, *others: "Result | str | PathLike[str]") -> Shown:
        """Whether runs agree with this one, as `simtune compare` says: a dict shown as its table.

        `others`: results, or folders of runs. Raises ValueError if they cannot be compared.
        """
        folders = [o.path if isinstance(o, Result) else Path(expanduser(o)) for o in others]
        return compare_runs([self.path, *folders])

    def evaluate(
        self,
        *,
        real: Recordings = None,
        parameters: Values = None,
        episodes: int | None = None,
        seed: int = EvaluateConfig.seed,
    ) -> dict[str, Any]:
        """Score the run on other episodes, as `simtune evaluate` does.

        Of `train`: the policy's scores, as in `score`, in its pseudo-real world, or in one with
        `parameters`: a JSON file or a dict, {name: value} or a result's `parameters`. With `real`,
        recordings or a list of dicts of arrays: what replays leave of readings before and after
        tuning, a dict shown as a table. Raises ValueError if the run has nothing to score.
        """
        return evaluate_run(self.path, real, parameters, {"episodes": episodes, "seed": seed})

    def to_pandas(self) -> "pandas.DataFrame":
        """One row per parameter, indexed by name. Needs pandas."""
        try:
            import pandas  # type: ignore[import-not-found]
        except ImportError:
            raise ImportError("to_pandas needs pandas: pip install pandas") from None
        rows = [asdict(estimate) for estimate in self.parameters.values()]
        return pandas.DataFrame(rows).set_index("name").dropna(axis="columns", how="all")

    def plot(self, names: Sequence[str] | None = None, ax: "Axes | None" = None) -> "Axes":
        """Plot estimates with 90 % intervals, relative to the bounds, along each scale.

        Without intervals, with the searched ranges. `names`: parameters, by default all. `ax`: a
        matplotlib axes, by default a new one.
        """
        title = f"{self.task}: estimates, {interval_label(self._run.search)}s"
        chosen = self._chosen(names)
        coordinates = {axis["name"]: axis for axis in self.content["covariance"]["coordinates"]}
        return plot_estimates(chosen, coordinates, title, ax)

    def plot_curves(self, names: Sequence[str] | None = None) -> "Figure":
        """Plot P(truth > value) of each parameter, with its 90 % interval, in a new figure.

        Raises InputError for a search without such curves.
        """
        chosen = self._chosen(names)
        if missing := [estimate.name for estimate in chosen if estimate.name not in self.curves]:
            raise InputError(f"this search tells no curve of {missing[0]}: --search posterior does")
        return plot_curves(chosen, self.curves)

    def plot_pairs(self, names: Sequence[str] | None = None) -> "Figure":
        """Plot draws of the joint posterior for each pair of parameters, in a new figure."""
        return plot_pairs(self._chosen(names), self.samples(_PLOTTED_DRAWS))

    def _chosen(self, names: Sequence[str] | None) -> list[ParameterEstimate]:
        """Estimates of `names`, by default all. Raises InputError without a search; UnknownName."""
        if not self.content.get("covariance"):
            raise InputError(
                f"{self.path} has no estimates to plot: nothing was searched for there"
            )
        names = list(self.parameters) if names is None else names
        chosen = [names] if isinstance(names, str) else list(names)
        if not chosen:
            raise InputError("names is empty: no parameter to plot")
        for name in chosen:
            if name not in self.parameters:
                raise UnknownName("parameter", name, str(self.path), self.parameters)
        return [self.parameters[name] for name in chosen]

    @property
    def curves(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """{name: (values (C,), P(truth > value) (C,))}: survival curves of the posterior."""
        return self._run.survival_curves()

    def __repr__(self) -> str:
        head = f"simtune.Result of {self.task}, {self.path}"
        rows = table.lines(self._run)
        return "\n".join([head, *rows, *(f"warning: {w}" for w in self.warnings)])

    def _repr_html_(self) -> str:
        warnings = "".join(f"<p>Please note: {table.escape(w)}</p>" for w in self.warnings)
        return table.html(self._run) + warnings
