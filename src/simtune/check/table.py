"""What `simtune check` prints."""

from typing import Any

_PREDICTED = ("motion", "at most", "told to")
_HEAD = ("parameter", "value", "tried", "picture", "of pixels", *_PREDICTED, "verdict")


def table(result: dict[str, Any]) -> list[str]:
    """Lines of plain text."""
    kind = result.get("actions", "the recordings'")
    lines = [
        f"{result['task']}: {result['episodes']} episodes of {result['steps']} steps of "
        f"{result['step_s']:.3g} s with {kind} actions"
    ]
    lines += _of_recordings(result["recordings"]) if "recordings" in result else []
    lines += [f"warning: {warning}" for warning in result.get("warnings", ())]
    if path := result.get("film", {}).get("pictures"):
        lines.append(f"pictures of the recordings beside the simulator's: {path}")
    lines += ["", *_rows(result["parameters"]), ""]
    if pairs := result["pairs"]:
        lines += [*(pair["says"] for pair in pairs), ""]
    return [*lines, *_LEGEND]


_LEGEND = (
    "picture: levels of 256 by which pixels change that change, if a parameter is as tried;",
    "motion: pixels of 64 by which what moves is elsewhere after 12 steps, root mean square;",
    "told to: standard deviation that the best fit to such videos could have.",
)


def _rows(parameters: dict[str, dict[str, Any]]) -> list[str]:
    """A line a parameter, columns below each other, numbers to the right."""
    rows = [_HEAD, *(_cells(name, p) for name, p in parameters.items())]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for name, *numbers, verdict in rows:
        columns = [f"{n:>{width}s}" for n, width in zip(numbers, widths[1:-1], strict=True)]
        lines.append("  ".join([f"{name:{widths[0]}s}", *columns, verdict]))
    return lines


def _of_recordings(facts: dict[str, Any]) -> list[str]:
    ranges = (f"{n} {low:.3g} to {high:.3g}" for n, (low, high) in facts["action_ranges"].items())
    film, lateness = "no pictures looked at", ""
    if facts["source_size"]:
        (height, width), late = facts["source_size"], facts["time_error_ms"]
        film = f"{width}×{height} {facts['codec']}, camera {facts['camera']}"
        lateness = (
            f"; frames away from their steps by {late['largest']:g} ms at most, "
            f"{late['mean']:g} ms on average"
        )
    return [
        f"{facts['folder']}: {facts['kind']}, sound: {facts['episodes']} episodes, "
        f"{facts['steps']} steps, {film}",
        f"{facts['fps']:.6g} steps/s recorded, {facts['control_hz']:.6g} taken{lateness}",
        f"actions: {', '.join(ranges) or 'none'}",
        f"dataset hash {facts['dataset_hash']}",
    ]


def _cells(name: str, p: dict[str, Any]) -> tuple[str, ...]:
    moves, changes = p["motion_largest_px"] > 0, p["picture_share"] > 0
    unit = f" {p['unit']}" if p["unit"] not in ("1", "×") else ""
    return (
        name,
        f"{p['value']:.4g}{unit}",
        f"{p['changed_to']:.4g}",
        f"{p['picture_levels']:.0f}" if changes else "–",
        f"{100 * p['picture_share']:.2g} %" if changes else "–",
        f"{p['motion_rms_px']:.2g} px" if moves else "–",
        f"{p['motion_largest_px']:.2g} px" if moves else "–",
        _predicted(p, unit),
        f"{p['verdict']}; {p['note']}" if p["note"] else p["verdict"],
    )


def _predicted(p: dict[str, Any], unit: str) -> str:
    if not p["motion_largest_px"]:
        return "visible" if p["picture_share"] else "–"
    return f"{p['std_percent']:.2g} %" if "std_percent" in p else f"{p['std']:.2g}{unit}"
