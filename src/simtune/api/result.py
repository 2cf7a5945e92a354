"""What a run found, as an object."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from simtune.api import table
from simtune.api.estimate import Estimate
from simtune.api.plot import plot_curves, plot_estimates, plot_pairs
from simtune.checking import table as check_lines
from simtune.config import ExportConfig
from simtune.errors import InputError, UnknownName
from simtune.export import draw_samples, export, tuned_model
from simtune.names import ExportFormat
from simtune.report.data import RunData
from simtune.tasks import with_model

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found]
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PLOTTED_DRAWS = 500  # more only blacken the plot


class CheckResult(dict[str, Any]):
    """What `simtune.check` found: a dict of JSON that shows itself as a table."""

    def __repr__(self) -> str:
        return "\n".join(check_lines(self))


class Result:
    """What a run found; `simtune.load` makes one of any finished run folder."""

    def __init__(self, run: RunData):
        self._run = run

    @property
    def path(self) -> Path:
        """The run's folder; its report.html says more."""
        return self._run.path

    @property
    def task(self) -> str:
        """The task's name."""
        return self.content["task"]

    @property
    def content(self) -> dict[str, Any]:
        """All that result.json holds (docs/architecture.md, "The run folder")."""
        return self._run.result

    @property
    def warnings(self) -> list[str]:
        """What to doubt, a sentence each."""
        return list(self.content.get("warnings", ()))

    @cached_property
    def parameters(self) -> dict[str, Estimate]:
        """Each parameter's estimate, by name, in the order that arrays have."""
        return {name: Estimate.read(name, its) for name, its in self._run.parameters.items()}

    @property
    def covariance(self) -> np.ndarray:
        """(N, N) in unit coordinates: from 0 at a parameter's low bound to 1 at its high one.

        Along its scale, which `content["covariance"]` names with the bounds. Raises ValueError for
        a run without a search.
        """
        if not (found := self._run.object("covariance")):
            raise InputError(f"{self.path} has no covariance: nothing was searched for there")
        return np.array(found["matrix"], float)

    def samples(self, num: int = 1000) -> dict[str, np.ndarray]:
        """Worlds drawn from the joint posterior: {name: (num,) values in its unit}.

        The same in every call; `np.column_stack(list(samples.values()))` is (num, N). Up to 4000
        are read from posterior.npz; more are drawn anew, which needs the task's files.
        Raises ValueError for a run without a search.
        """
        if num < 1:
            raise InputError(f"num must be at least 1, got {num}")
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
        """The task's model with the estimates written into it, as the run simulated it.

        Raises ValueError where the task's files are gone or changed, or have no MuJoCo model.
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
        """What `simtune export` writes into the new folder `out`; returns it.

        model.xml, parameters.json, apply.py; with `samples` draws of the posterior: samples.csv,
        and for the training of the library that `format` names: worlds.npz and a module.
        """
        config = ExportConfig(run_folder=self.path, out=Path(out), samples=samples, format=format)
        return export(config)

    def to_pandas(self) -> "pandas.DataFrame":
        """A row a parameter, by name. Needs pandas."""
        try:
            import pandas  # type: ignore[import-not-found]
        except ImportError:
            raise ImportError("to_pandas needs pandas: pip install pandas") from None
        rows = [asdict(estimate) for estimate in self.parameters.values()]
        return pandas.DataFrame(rows).set_index("name").dropna(axis="columns", how="all")

    def plot(self, names: Sequence[str] | None = None, ax: "Axes | None" = None) -> "Axes":
        """Estimates with 90 % intervals (`names`: some of them), in a matplotlib axes.

        Relative to the bounds, along each parameter's scale. `ax`: an axes of yours.
        """
        title = f"{self.task}: estimates, 90 % intervals"
        chosen = self._chosen(names)
        coordinates = {its["name"]: its for its in self.content["covariance"]["coordinates"]}
        return plot_estimates(chosen, coordinates, title, ax)

    def plot_curves(self, names: Sequence[str] | None = None) -> "Figure":
        """P(truth > value) of each parameter, with its 90 % interval: a matplotlib figure."""
        return plot_curves(self._chosen(names), self.curves)

    def plot_pairs(self, names: Sequence[str] | None = None) -> "Figure":
        """Draws of the joint posterior, each two parameters against each other: a figure."""
        return plot_pairs(self._chosen(names), self.samples(_PLOTTED_DRAWS))

    def _chosen(self, names: Sequence[str] | None) -> list[Estimate]:
        """All, or those of `names`. Raises InputError without a search, and UnknownName."""
        if not self.content.get("covariance"):
            raise InputError(
                f"{self.path} has no estimates to plot: nothing was searched for there"
            )
        for name in names or ():
            if name not in self.parameters:
                raise UnknownName("parameter", name, str(self.path), self.parameters)
        return [self.parameters[name] for name in names or self.parameters]

    @property
    def curves(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """{name: (values (C,), P(truth > value) (C,))}: survival curves of the posterior."""
        return {
            name: (np.array(curve["candidates"]), np.array(curve["prob_higher"]))
            for name, curve in self._run.curves.items()
        }

    def __repr__(self) -> str:
        head = f"simtune.Result of {self.task}, {self.path}"
        rows = table.lines(self._run.parameters, self._run.is_tuned)
        return "\n".join([head, *rows, *(f"warning: {w}" for w in self.warnings)])

    def _repr_html_(self) -> str:
        warnings = "".join(f"<p>Please note: {table.escape(w)}</p>" for w in self.warnings)
        return table.html(self._run.parameters, self._run.is_tuned) + warnings
