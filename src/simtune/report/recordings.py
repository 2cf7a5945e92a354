"""The report's section on the recordings that a run was tuned to."""

from typing import Any

from simtune.report.data import RunData
from simtune.report.words import count, number, text


def recordings(run: RunData) -> str:
    """Empty where nothing was recorded, as in a pseudo-real world."""
    facts = run.result.get("recordings")
    if not isinstance(facts, dict):
        return ""
    rows = {label: value for label, value in _told(facts).items() if value}
    listed = "".join(f"<dt>{label}</dt><dd>{value}</dd>" for label, value in rows.items())
    return f"<section><h2>The recordings</h2><dl>{listed}</dl></section>" if rows else ""


def _told(facts: dict[str, Any]) -> dict[str, str]:
    height, width = (facts.get("source_size") or (None, None))[:2]
    error, ranges = facts.get("time_error_ms") or {}, facts.get("action_ranges") or {}
    taken, there = facts.get("episodes"), facts.get("episodes_in_dataset")
    return {
        "folder": text(facts["folder"]) if facts.get("folder") else "",
        "kind": text(facts["kind"]) if facts.get("kind") else "",
        "robot": text(facts["robot"]) if facts.get("robot") else "",
        "episodes": f"{count(taken)} of {count(there)}, {count(facts.get('steps'))} steps"
        if taken
        else "",
        "pictures": f"{text(width)}×{text(height)} pixels, {text(facts.get('codec'))}, "
        f"camera {text(facts.get('camera'))}"
        if width
        else "",
        "steps a second": f"{number(facts.get('fps'))} recorded, {number(facts.get('control_hz'))} "
        f"taken; frames are at most {number(error.get('largest'))} ms away from their steps"
        if facts.get("fps")
        else "",
        "actions": "<br>".join(
            f"{text(name)} {number(low)} to {number(high)}" for name, (low, high) in ranges.items()
        ),
        "content": f"SHA-256 {text(facts['dataset_hash'])}" if facts.get("dataset_hash") else "",
    }
