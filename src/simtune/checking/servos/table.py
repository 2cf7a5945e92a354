"""The table of how joints follow their commands, in plain text."""

from typing import Any

from simtune.columns import aligned

_HEAD = ("joint", "moves", "lag", "steps", "offset", "left", "with a lag of 1st order", "noise")
_LEGEND = (
    "lag: the constant delay behind the command that leaves least; offset: measured − commanded, "
    "so late;",
    "left: root mean square of the rest, and with a first-order lag instead of some of the delay;",
    "noise: how rough readings are, at most: fast motion counts in it.",
)
_PLAY = (
    "Dry friction leaves that (kind friction_loss, twice the friction by kp), and so does play",
    "between the motor and what is measured ([[backlash]], kind backlash).",
)


def servo_lines(servos: dict[str, dict[str, Any]]) -> list[str]:
    """A line per joint, in its unit; small numbers in thousandths of it."""
    rows = [_HEAD, *(_cells(name, s) for name, s in servos.items())]
    return [*aligned(rows, left=(0, len(_HEAD) - 1)), "", *_LEGEND, *_behind(servos)]


def _behind(servos: dict[str, dict[str, Any]]) -> list[str]:
    """Joints with hysteresis, and what to declare."""
    found = [f"{n} by {s['play']:.2g} {s['unit']}" for n, s in servos.items() if s["play"]]
    return [f"Behind to both sides, from end to end: {', '.join(found)}.", *_PLAY] * bool(found)


def _cells(name: str, servo: dict[str, Any]) -> tuple[str, ...]:
    unit = servo["unit"]
    lag = servo["lag_s"]
    return (
        name,
        _size(servo["travel"], unit),
        "–" if lag is None else f"{1e3 * lag:.0f} ms",
        "–" if lag is None else f"{servo['lag_steps']:.1f}",
        *(in_thousandths(servo[key], unit) for key in ("offset", "rms", "filtered_rms", "noise")),
    )


def _size(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.2f} {unit}"


def in_thousandths(value: float | None, unit: str) -> str:
    """In thousandths of the unit, if it is less than that."""
    if value is None or value != value:
        return "–"
    return f"{value:.2f} {unit}" if abs(value) >= 1 else f"{1e3 * value:.1f} m{unit}"
