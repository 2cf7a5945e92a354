"""Numbers and times as text: the templates' filters."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from markupsafe import Markup, escape

from simtune.columns import counted, significant, within
from simtune.names import search_traits
from simtune.run_data import RunData
from simtune.validate import is_number

MISSING = "–"


def number(value: Any) -> str:
    """Three significant digits: 0.0123, 4.57, 1,230."""
    return significant(value) if is_number(value) else MISSING


def as_precise(value: Any, facts: Mapping[str, Any]) -> str:
    """A value in the decimals of its parameter's interval; like `number`, if none is known."""
    low, high = facts.get("low"), facts.get("high")
    if not (is_number(value) and is_number(low) and is_number(high)):
        return number(value)
    return within(value, low, high)


def count(value: Any) -> str:
    return f"{value:,}" if isinstance(value, int) else number(value)


def percent(value: Any) -> str:
    return f"{value:.1f} %" if is_number(value) else MISSING


def share(value: float) -> str:
    """A share in percent, with one decimal below 10 %."""
    return f"{100 * value:.1f} %" if value < 0.1 else f"{100 * value:,.0f} %"


def covered(value: float) -> str:
    """How much of the first range an interval covers: it may be wider, within the bounds."""
    return "> 100 %" if value > 1 else share(value)


def interval(facts: Mapping[str, Any]) -> str:
    """[low, high] of a parameter or an event; empty if either is unknown."""
    low, high = facts.get("low"), facts.get("high")
    if not (is_number(low) and is_number(high)):
        return ""
    return f"[{within(low, low, high)}, {within(high, low, high)}]"


def interval_label(search: str | None) -> str:
    """What low and high are the ends of, by how the run searched for parameters."""
    if search is None:
        return "worlds trained in"
    return "90 % interval" if search_traits(search).has_intervals else "searched range"


def unit(facts: Mapping[str, Any]) -> str:
    """A parameter's unit; empty for a pure number."""
    value = facts.get("unit")
    return "" if value in (None, "", "1") else str(value)


def breakable(name: str) -> Markup:
    """A parameter's name that can be wrapped after an underscore."""
    parts = escape(name).replace("_", Markup("_<wbr>"))
    return Markup("<span>{}</span>").format(parts)


_REAL = {"pseudo": "a simulated truth", "xarm": "a robot", "lerobot": "a robot"}
_POLICIES = {
    "dr": "A policy was trained in worlds around the start; nothing was tuned to {}",
    "untuned": "A policy was trained in the simulator as it starts; nothing was tuned to {}",
    "oracle": "A policy was trained in the true world itself, {}",
}


def headline(run: RunData) -> str:
    """What a run did, as the start of a sentence that ends in its recordings or robot."""
    real = _REAL.get(str(run.get("real")), "recordings")
    if run.get("method") in _POLICIES:
        return _POLICIES[run.get("method")].format(real)
    trains = "policy_steps" in run.config
    begin = "A policy was trained while the simulator was" if trains else "The simulator was"
    how = search_traits(run.get("search")).in_words
    return " ".join(filter(None, (begin, "tuned", how, "to", real)))


def not_looked_at(names: Collection[str]) -> str:
    """On parameters that only pictures show, of a run without any; empty if there are none."""
    num = len(names)
    shows = "shows" if num == 1 else "show"
    return f"{counted(num, 'parameter')} {shows} in pictures only: not looked at" * bool(num)


def further_off(readings: Sequence[str]) -> str:
    """On joint readings that replays after tuning meet worse than those before."""
    verb = "is" if len(readings) == 1 else "are"
    return f"after tuning, {', '.join(readings)} {verb} further off than before"


def diverging(readings: Mapping[str, Mapping[str, Any]], num_episodes: Any) -> list[str]:
    """On replays that diverge before tuning, or as tuned, as the facts on readings count them."""
    said = []
    for key, when in (("diverged_before", "before tuning"), ("diverged", "as tuned")):
        counts = (facts.get(key) for facts in readings.values())
        num = max((its for its in counts if isinstance(its, int)), default=0)
        if num and num == num_episodes:
            said.append(f"{when}, the simulator diverges in every replay: nothing to compare")
        elif num:
            of_all = counted(num, "replay")
            if isinstance(num_episodes, int):
                of_all = f"{num} of {counted(num_episodes, 'replay')}"
            said.append(f"{when}, the simulator diverges in {of_all}: not counted")
    return said


def duration(seconds: Any) -> str:
    """Seconds as text: 45 s, 3 min 20 s, 2 h 05 min."""
    if not is_number(seconds):
        return MISSING
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 1:
        return f"{rest} s"
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"
