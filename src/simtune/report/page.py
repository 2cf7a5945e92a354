"""Fills the templates with the content of a run folder, and writes the page into it."""

import base64
import json
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, Undefined
from markupsafe import Markup

from simtune.errors import InputError
from simtune.report import (
    joint_plots,
    pair_plots,
    part_plots,
    plots,
    precision_table,
    rank_plots,
    trust,
    words,
)
from simtune.run.files import write_atomically
from simtune.run_data import POLICY_VIDEO, VIDEOS, RunData, read_run
from simtune.validate import is_number
from simtune.verdicts import IDENTIFIED_SHARE, WEAK_SHARE


def write_report(run_path: Path | str) -> Path:
    """Write report.html into a run folder, from the folder's content; returns its path.

    The report of a run that is still going shows the state so far. Raises InputError if `run_path`
    is not a run, is damaged, or cannot be written.
    """
    run = read_run(Path(run_path))
    path = run.path / "report.html"
    try:
        write_atomically(path, _page(run))
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error
    return path


def _page(run: RunData) -> str:
    template = _environment().get_template("page.html")
    return template.render(
        run=run,
        title=run.title,
        style=_asset("style.css"),
        script=_asset("script.js"),
        videos={name: run.videos[name] for name in VIDEOS if name in run.videos},
        policy_video=run.videos.get(POLICY_VIDEO),
        learning_curve=plots.learning_curve(run),
        ranks=trust.ranks(run),
        comparisons=precision_table.compare(run),
        pairs=trust.pairs(run),
        poses=trust.poses(run),
        enough_worlds=rank_plots.ENOUGH_WORLDS,
        identified_share=IDENTIFIED_SHARE,
        weak_share=WEAK_SHARE,
        config=json.dumps(run.config, indent=2, ensure_ascii=False),
        result_file=json.dumps(run.result, indent=2).encode(),
        written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )


@cache  # it keeps templates compiled, which takes longer than to fill them
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("simtune.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_shown,
    )
    filters = (words.number, words.count, words.percent, words.share, words.interval)
    filters += (words.covered, words.as_precise)
    environment.filters |= {
        f.__name__: f for f in (*filters, words.unit, words.duration, words.breakable)
    }
    environment.filters["base64"] = lambda data: base64.b64encode(data).decode()
    environment.filters["in_thousandths"] = joint_plots.in_thousandths
    environment.tests["finite"] = is_number
    drawn = (plots.estimate_plot, plots.survival_plot, rank_plots.rank_histogram)
    drawn += (rank_plots.rank_dots, pair_plots.pair_plot)
    drawn += (joint_plots.reading_plot, joint_plots.error_plot, part_plots.part_distances)
    environment.globals |= {f.__name__: f for f in drawn} | {
        "interval_label": words.interval_label,
        "headline": words.headline,
        "not_looked_at": words.not_looked_at,
        "holds_truth": trust.holds_truth,
        "mean_error": trust.mean_error,
        "num_holding": trust.num_holding,
        "reasons": precision_table.reasons,
        "ends_farther": part_plots.ends_farther,
        "never_detected": part_plots.never_detected,
        "readings_farther": trust.readings_farther,
        "further_off": words.further_off,
        "diverging": words.diverging,
    }
    return environment


def _shown(value: object) -> object:
    """A value as the templates print it: a dash if it is missing."""
    return words.MISSING if value is None or isinstance(value, Undefined) else value


def _asset(name: str) -> Markup:
    return Markup(files("simtune.report").joinpath(name).read_text(encoding="utf-8"))
