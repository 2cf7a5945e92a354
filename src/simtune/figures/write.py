"""`simtune figures`: writes a page, and each figure as SVG, PNG and CSV."""

import csv
import io
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader
from markupsafe import Markup

from simtune.errors import InputError
from simtune.figures import tables
from simtune.figures.draw import LEGEND, colour, draw, with_legend
from simtune.figures.figure import Figure
from simtune.figures.gather import figures_of
from simtune.figures.groups import Setting, settings
from simtune.figures.raster import png
from simtune.figures.records import FinishedRun, read_records
from simtune.report import words
from simtune.run.files import write_atomically
from simtune.validate import is_number

PAGE = "figures.html"


def write_figures(folder: Path | str) -> Path:
    """Draw figures of all runs in a folder; returns the page's path.

    Raises InputError if no run has a result, or nothing can be written.
    """
    folder = Path(folder)
    records, unfinished = read_records(folder)
    found = settings(records)
    drawn = {setting.key: figures_of(setting) for setting in found}
    environment = _environment()
    try:
        _write_files(folder / "figures", environment, found, drawn, records)
        page = environment.get_template("figures.html").render(
            settings=found,
            figures=drawn,
            overall=[(t, tables.overall(group), len(group)) for t, group in _trainings(found)],
            num_runs=len(records),
            unfinished=unfinished,
            title=f"Runs of {folder.resolve().name}",
            written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        )
        write_atomically(folder / PAGE, page)
    except OSError as error:
        raise InputError(f"cannot write into {folder}: {error.strerror}") from error
    return folder / PAGE


def _trainings(found: Sequence[Setting]) -> list[tuple[str, list[Setting]]]:
    """(title, settings) to summarise over tasks: without a reality gap, and with one."""
    usual = [s for s in found if s.is_training and not s.is_pretrained]
    names = {False: "All tasks", True: "All tasks, through the gap"}
    apart = [(names[g], [s for s in usual if s.has_gap == g]) for g in names]
    return [(name, group) for name, group in apart if len(group) > 1]


def _write_files(
    folder: Path,
    environment: Environment,
    found: Sequence[Setting],
    drawn: Mapping[str, Sequence[Figure]],
    records: Sequence[FinishedRun],
) -> None:
    folder.mkdir(exist_ok=True)
    template = environment.get_template("figure.svg.html")
    for figure in (figure for figures in drawn.values() for figure in figures):
        plot = with_legend(figure)
        write_atomically(folder / f"{figure.key}.svg", template.render(plot=plot, legend=LEGEND))
        write_atomically(folder / f"{figure.key}.png", png(plot))
        write_atomically(folder / f"{figure.key}.csv", _csv(figure.rows()))
    table = [tables.flat(row) for setting in found for row in tables.rows(setting)]
    write_atomically(folder / "table.csv", _csv(table))
    write_atomically(folder / "runs.csv", _csv([tables.run_row(record) for record in records]))


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    names = list(dict.fromkeys(name for row in rows for name in row))
    file = io.StringIO()
    writer = csv.DictWriter(file, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: v for k, v in row.items() if v == v} for row in rows)  # NaN: unknown
    return file.getvalue()


@cache  # it keeps templates compiled
def _environment() -> Environment:
    loaders = [PackageLoader("simtune.figures"), PackageLoader("simtune.report")]
    environment = Environment(
        loader=ChoiceLoader(loaders), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {f.__name__: f for f in (words.number, words.count, words.percent)}
    environment.filters |= {"colour": colour, "share": words.share}
    environment.tests["finite"] = is_number
    environment.globals |= {"draw": draw, "rows": tables.rows, "authors": tables.authors}
    style = files("simtune.report").joinpath("style.css").read_text(encoding="utf-8")
    own = files("simtune.figures").joinpath("style.css").read_text(encoding="utf-8")
    environment.globals |= {"style": Markup(style + own), "own_style": Markup(own)}
    return environment
