"""Numbers, times and events in words."""

from html import escape
from typing import Any

from simtune.validate import is_number

MISSING = "–"


def text(value: Any) -> str:
    """Any value as text that is safe inside HTML."""
    return MISSING if value is None else escape(str(value))


def number(value: Any) -> str:
    """Three digits that count: 0.0123, 4.57, 1,230, 2.1e-05."""
    if not is_number(value):
        return MISSING
    if value == 0:
        return "0"
    if not 1e-3 <= abs(value) < 1e6:
        return f"{value:.2e}"
    digits = 2 - int(f"{value:e}".split("e")[1])
    return f"{round(value, digits):,.{max(digits, 0)}f}"


def count(value: Any) -> str:
    return f"{value:,}" if isinstance(value, int) else number(value)


def percent(value: Any) -> str:
    return f"{value:.1f} %" if is_number(value) else MISSING


def interval(low: Any, high: Any) -> str:
    return f"[{number(low)}, {number(high)}]" if is_number(low) and is_number(high) else ""


def unit(value: Any) -> str:
    """A unit behind a number; a pure number has none."""
    return "" if value in (None, "", "1") else f" {text(value)}"


def duration(seconds: Any) -> str:
    """Seconds as people say them: 45 s, 3 min 20 s, 2 h 05 min."""
    if not is_number(seconds):
        return MISSING
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 1:
        return f"{rest} s"
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def event_sentence(event: dict[str, Any], parameter: dict[str, Any]) -> str:
    """An event as HTML: "ball_mass: range widened to [0.2, 0.8] kg, because …"."""
    symbol = unit(parameter.get("unit"))
    words = f"<b>{text(event.get('parameter'))}</b> {text(event.get('event'))}"
    if now := interval(event.get("low"), event.get("high")):
        words += f" to <span class='nowrap'>{now}{symbol}</span>"
    return words + (f" – {text(event['reason'])}" if event.get("reason") else "")
