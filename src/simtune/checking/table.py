"""Output of `simtune check`."""

from typing import Any

from simtune.checking.servos.table import servo_lines
from simtune.columns import aligned, counted, cut, two_digits
from simtune.recordings.source import short

_MOST_EXTENTS = 6
_PICTURE = ("picture", "of pixels", "motion", "at most")
_READING = ("reads", "at most", "of")
# What columns say; {px}: the pictures' height, {what}: what is fitted
_TRIED = {"tried": "another value, of which the next columns say what it changes"}
_OF_PICTURES = {
    "picture": "by how many of 256 levels the pixels that change do so",
    "of pixels": "the share of pixels that change",
    "motion": "by how many pixels, of {px}, things are elsewhere after 12 steps, root mean square",
}
_OF_READINGS = {
    "reads": "by how much the reading that tells most is off in replays, root mean square",
}
_OF_BOTH = {"at most": "the largest of these"}
_TOLD = {"told to": "standard deviation that the best fit to such {what} could have"}
_AT_BEST = {"at best": "the same if it left nothing of the readings but their noise"}


def table(result: dict[str, Any]) -> list[str]:
    """Lines of plain text."""
    recorded = result.get("recordings", {}).get("action_ranges", True)
    kind = result.get("actions", "the recordings'" if recorded else "no")
    lines = [
        f"{result['task']}: {counted(result['episodes'], 'episode')} of "
        f"{counted(result['steps'], 'step')} of {result['step_s']:.3g} s with {kind} actions"
    ]
    lines += _of_recordings(result["recordings"]) if "recordings" in result else []
    lines += [f"warning: {warning}" for warning in result.get("warnings", ())]
    for film in result.get("films", {}).values():
        lines.append(f"pictures of the recordings beside the simulator's: {film['pictures']}")
    if path := result.get("servo_pictures"):
        lines.append(f"how joints follow their commands: {path}")
    if extents := result.get("extents_px"):
        lines.append(_extents(extents, result["image_size"]))
    if servos := result.get("servos"):
        lines += ["", *servo_lines(servos)]
    if named := result.get("servos_on_tendons"):
        lines += ["", f"Not compared with their commands: servos on tendons ({short(named)})."]
    lines += ["", *_rows(result["parameters"]), ""]
    if pairs := result["pairs"]:
        lines += [*(pair["says"] for pair in pairs), ""]
    return lines + _legend(result)


def _extents(extents: dict[str, float], image_size: int) -> str:
    largest = sorted(extents.items(), key=lambda extent: -extent[1])
    said = cut([f"{name} {_across(px)}" for name, px in largest], _MOST_EXTENTS)
    return f"across what moves, in pixels of {image_size}: {said}"


def _across(px: float) -> str:
    """Nothing is seen of a body that is out of the picture in most frames."""
    return f"{px:.1f}" if px >= 0.05 else "mostly out of sight"


def _legend(result: dict[str, Any]) -> list[str]:
    """A line for each column."""
    pictures, readings = _shown(result["parameters"])
    said = _TRIED | (_OF_PICTURES if pictures else {}) | (_OF_READINGS if readings else {})
    said |= _OF_BOTH | _TOLD
    if _has_both(result["parameters"]):
        said |= _AT_BEST
    what = " and ".join(["videos"] * pictures + ["readings"] * readings)
    size = result.get("image_size")
    rows = [(name, text.format(px=size, what=what)) for name, text in said.items()]
    if assumed := result.get("assumed"):
        rows.insert(1 + list(said).index("told to"), ("", assumed))
    return ["Columns:", *aligned([(f"  {name}", text) for name, text in rows], left=(0, 1))]


def _shown(parameters: dict[str, dict[str, Any]]) -> tuple[bool, bool]:
    """Whether pictures, and whether readings were used."""
    some = next(iter(parameters.values()), {"picture_levels": 0.0})
    return "picture_levels" in some, "reading" in some


def _has_both(parameters: dict[str, dict[str, Any]]) -> bool:
    """Whether it depends on what a fit leaves how well parameters are told."""
    return any("interval_share_at_best" in p for p in parameters.values())


def _rows(parameters: dict[str, dict[str, Any]]) -> list[str]:
    """A line per parameter, in columns, numbers aligned to the right."""
    pictures, readings = _shown(parameters)
    columns = (*_PICTURE * pictures, *_READING * readings)
    told = ("at best", "told to") if _has_both(parameters) else ("told to",)
    head = ("parameter", "value", "tried", *columns, *told, "verdict")
    rows = [head, *(_cells(name, p) for name, p in parameters.items())]
    return aligned(rows, left=(0, len(head) - 1))


def _of_recordings(facts: dict[str, Any]) -> list[str]:
    ranges = (f"{n} {low:.3g} to {high:.3g}" for n, (low, high) in facts["action_ranges"].items())
    films, lateness = [], ""
    for camera in facts["cameras"]:
        height, width = camera["source_size"]
        films.append(f"{width}×{height} {camera['codec']}, camera {camera['key']}")
    late = [camera["time_error_ms"] for camera in facts["cameras"]]
    worst = max(late, key=lambda error: error["largest"], default={"largest": 0.0})
    if worst["largest"] > 0:
        lateness = (
            f"; frames away from their steps by {worst['largest']:g} ms at most, "
            f"{worst['mean']:g} ms on average"
        )
    film = " and ".join(films) or "no pictures looked at"
    episodes = counted(facts["episodes"], "episode")
    return [
        f"{facts['folder']}: {facts['kind']}, readable: {episodes}, "
        f"{counted(facts['steps'], 'step')}, {film}",
        f"{facts['fps']:.6g} steps/s recorded, {facts['control_hz']:.6g} taken{lateness}",
        f"actions: {', '.join(ranges) or 'none'}",
    ]


def _cells(name: str, p: dict[str, Any]) -> tuple[str, ...]:
    unit = f" {p['unit']}" if p["unit"] not in ("1", "×") else ""
    return (
        name,
        f"{p['value']:.4g}{unit}",
        f"{p['changed_to']:.4g}",
        *_picture_cells(p),
        *_reading_cells(p),
        *((_predicted(p, unit, "_at_best"),) if "interval_share_at_best" in p else ()),
        _predicted(p, unit),
        f"{p['verdict']}; {p['note']}" if p["note"] else p["verdict"],
    )


def _picture_cells(p: dict[str, Any]) -> tuple[str, ...]:
    if "picture_levels" not in p:
        return ()
    moves, changes = p["motion_largest_px"] > 0, p["picture_share"] > 0
    return (
        f"{p['picture_levels']:.0f}" if changes else "–",
        f"{two_digits(100 * p['picture_share'])} %" if changes else "–",
        f"{two_digits(p['motion_rms_px'])} px" if moves else "–",
        f"{two_digits(p['motion_largest_px'])} px" if moves else "–",
    )


def _reading_cells(p: dict[str, Any]) -> tuple[str, ...]:
    if "reading" not in p:
        return ()
    if not p["reading_largest"] > 0:
        return ("–",) * len(_READING)
    unit = p["reading_unit"]
    sizes = (f"{two_digits(p[key])} {unit}" for key in ("reading_rms", "reading_largest"))
    return (*sizes, p["reading"])


def _predicted(p: dict[str, Any], unit: str, which: str = "") -> str:
    if not (p.get("motion_largest_px") or p.get("reading_largest")):
        return "visible" if p.get("picture_share") else "–"
    for key, its_unit in (("std_percent", " %"), ("std", unit)):
        if (std := p.get(key + which)) is not None:
            return two_digits(std) + its_unit
    return "visible"
