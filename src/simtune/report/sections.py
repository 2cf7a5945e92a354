"""The report's sections as HTML; a section that has nothing to show is empty."""

import base64
from typing import Any

from simtune.report.data import VIDEOS, RunData
from simtune.report.plots import estimate_plot, survival_plot
from simtune.report.tables import chip
from simtune.report.verdicts import explanation
from simtune.report.words import (
    count,
    duration,
    event_sentence,
    interval,
    number,
    percent,
    text,
    unit,
)
from simtune.validate import is_number

_CAPTIONS = {
    "real": ("Real world", "the video that was given"),
    "before": ("Simulator before", "same actions, parameters at their start"),
    "after": ("Simulator after", "same actions, parameters as estimated"),
    "overlay": ("Both", "grey: alike; red: only the real one is bright; cyan: only the simulator"),
}


def subtitle(run: RunData) -> str:
    facts = {"real world": "real", "method": "method", "search": "search", "seed": "seed"}
    known = {label: run.get(key) for label, key in facts.items()}
    return " · ".join(f"{k} <b>{text(v)}</b>" for k, v in known.items() if v is not None)


def tiles(run: RunData) -> str:
    """The figures that sum up the run."""
    parameters = list(run.parameters.values()) if run.is_tuned else []
    sure = sum(p.get("verdict") == "identified" for p in parameters)
    errors = [e for p in parameters if is_number(e := p.get("percent_error"))]
    figures = []
    if run.result and parameters:
        figures.append((f"{sure} of {len(parameters)}", "parameters identified"))
    if errors:
        figures.append((percent(sum(errors) / len(errors)), "mean error"))
    for key in ("return", "success"):
        score = run.get(key)
        if isinstance(score, dict):
            episodes = f", {count(score['episodes'])} episodes" if "episodes" in score else ""
            figures.append(
                (f"{number(score.get('mean'))} ± {number(score.get('std'))}", key + episodes)
            )
    figures += [
        (count(run.get("real_episodes")), "real episodes"),
        (count(run.get("sim_steps")), "simulated steps"),
        (duration(run.get("wall_s")), "wall time"),
    ]
    return "".join(f"<div><b>{value}</b><span>{label}</span></div>" for value, label in figures)


def warnings(run: RunData) -> str:
    listed = run.result.get("warnings") or []
    given = [text(warning) for warning in ([listed] if isinstance(listed, str) else listed)]
    if not run.result:
        given.insert(0, "This run has not finished: the figures are those of its last round.")
    items = "".join(f"<li>{warning}</li>" for warning in given)
    return f"<aside class='warnings'><h2>Please note</h2><ul>{items}</ul></aside>" if given else ""


def videos(run: RunData) -> str:
    """The videos side by side, each inside the page."""
    figures = []
    for name in (name for name in VIDEOS if name in run.videos):
        caption, detail = _CAPTIONS[name]
        data = base64.b64encode(run.videos[name]).decode()
        figures.append(
            f"<figure><video muted loop playsinline preload='auto' aria-label='{caption}' "
            f"src='data:video/mp4;base64,{data}'></video>"
            f"<figcaption><b>{caption}</b>{detail} <a download='{name}.mp4'>download</a>"
            "</figcaption></figure>"
        )
    if not figures:
        return ""
    controls = (
        "<div class='controls' hidden><button type='button'>Play</button>"
        "<input type='range' min='0' max='1' step='any' value='0' aria-label='Position'></div>"
    )
    shown = f"<div class='videos'>{''.join(figures)}</div>{controls}"
    return f"<section id='videos'><h2>The same actions, side by side</h2>{shown}</section>"


def plots(run: RunData) -> str:
    """A card a parameter: the estimate against the search's rounds, and the survival curve."""
    cards = "".join(_card(run, name) for name in run.parameters)
    if not cards:
        return ""
    legend = _legend(any(is_number(p.get("real")) for p in run.parameters.values()))
    shown = f"{legend}<div class='cards'>{cards}</div>"
    return f"<section><h2>How each estimate came about</h2>{shown}</section>"


def _card(run: RunData, name: str) -> str:
    p, curve = run.parameters[name], run.curves.get(name) or {}
    initial, truth, low, high = (
        value if is_number(value := p.get(key)) else None
        for key in ("initial", "real", "low", "high")
    )
    between = None if low is None or high is None else (low, high)
    candidates, prob_higher = curve.get("candidates", []), curve.get("prob_higher", [])
    is_colour = run.is_colour(name)
    drawn = estimate_plot(name, run.history(name), initial, truth, is_colour)
    drawn += survival_plot(name, candidates, prob_higher, between, truth, is_colour)
    if not drawn:
        return ""
    value = f"{number(p.get('mean'))}{unit(p.get('unit'))} <small>{interval(low, high)}</small>"
    head = f"<h3>{text(name)}</h3><span class='value'>{value}</span>{chip(p.get('verdict'))}"
    why = explanation(p, is_colour)
    said = f"<p class='note'>{why}</p>" if why else ""
    return f"<article><header>{head}</header><div>{drawn}</div>{said}</article>"


def _legend(has_truth: bool) -> str:
    keys = {"estimate": "estimate", "interval": "90 % interval", "range": "searched range"}
    keys |= {"truth": "truth"} if has_truth else {}
    items = "".join(f"<span><i class='{k}'></i>{label}</span>" for k, label in keys.items())
    return (
        f"<p class='legend'>{items}<span>first plot: against the search's rounds · "
        "second: probability that the truth is higher than a candidate</span></p>"
    )


def events(run: RunData) -> str:
    """The widening and narrowing of ranges in words, grouped by when they happened."""
    groups: dict[Any, list[dict[str, Any]]] = {}
    for event in run.events:
        groups.setdefault(event.get("step"), []).append(event)
    items = []
    for step, together in groups.items():
        when = f"{count(step)} steps · {duration(together[0].get('wall_s'))}"
        known = run.parameters
        lines = (event_sentence(e, known.get(str(e.get("parameter")), {})) for e in together)
        listed = "".join(f"<li>{line}</li>" for line in lines)
        items.append(f"<li><span class='when'>{when}</span><ul>{listed}</ul></li>")
    if not items:
        return ""
    is_open = "open" if len(run.events) <= 12 else ""
    summary = f"<summary>{len(run.events)} changes of the searched ranges</summary>"
    listed = f"<details {is_open}>{summary}<ol class='events'>{''.join(items)}</ol></details>"
    return f"<section><h2>What happened on the way</h2>{listed}</section>"


def provenance(run: RunData) -> str:
    versions = run.stored.get("versions")
    facts = {"started": run.stored.get("created")} | (
        versions if isinstance(versions, dict) else {}
    )
    rows = "".join(f"<dt>{text(k)}</dt><dd>{text(v)}</dd>" for k, v in facts.items() if v)
    command = run.get("command")
    code = f"<pre class='command'>{text(command)}</pre>" if command else ""
    return f"{code}<dl>{rows}</dl>"
