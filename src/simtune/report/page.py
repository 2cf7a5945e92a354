"""Put the report together and write it into the run folder."""

import base64
import json
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from simtune.errors import InputError
from simtune.report import sections
from simtune.report.data import RunData, read_run
from simtune.report.policy import policy
from simtune.report.recordings import recordings
from simtune.report.tables import parameters
from simtune.report.trust import trust
from simtune.report.words import text
from simtune.run import write_atomically


def write_report(run_path: Path | str) -> Path:
    """Write report.html into a run folder, from what lies there; returns its path.

    A run that is still going gets a report of what there is so far.
    Raises InputError where `run_path` is no run, is damaged, or cannot be written.
    """
    run = read_run(Path(run_path))
    path = run.path / "report.html"
    try:
        write_atomically(path, _page(run))
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error
    return path


def _page(run: RunData) -> str:
    return Template(_asset("template.html")).substitute(
        title=text(run.get("task") or run.path.resolve().name),
        subtitle=sections.subtitle(run),
        style=_asset("style.css"),
        script=_asset("script.js") if run.videos else "",
        tiles=sections.tiles(run),
        warnings=sections.warnings(run),
        videos=sections.videos(run),
        policy=policy(run),
        parameters=parameters(run),
        trust=trust(run),
        recordings=recordings(run),
        plots=sections.plots(run) if run.is_tuned else "",
        events=sections.events(run),
        reading=_asset("reading.html") if run.is_tuned else "",
        provenance=sections.provenance(run),
        result=_json_link(run.result) if run.result else "",
        config=text(json.dumps(run.config, indent=2, ensure_ascii=False)),
        written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )


def _json_link(result: dict[str, Any]) -> str:
    data = base64.b64encode(json.dumps(result, indent=2).encode()).decode()
    return (
        "<p><a download='result.json' "
        f"href='data:application/json;base64,{data}'>Download result.json</a></p>"
    )


def _asset(name: str) -> str:
    return files("simtune.report").joinpath(name).read_text(encoding="utf-8")
