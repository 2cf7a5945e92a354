"""The output of `simtune compare`."""

from typing import Any

from simtune.columns import aligned, counted, within
from simtune.report.words import interval


def table(result: dict[str, Any]) -> list[str]:
    """A table in lines of plain text, with notes and a conclusion."""
    runs = range(1, len(result["runs"]) + 1)
    head = ("parameter", *(t for i in runs for t in (f"run {i}", "90 % interval")), "differ by")
    rows = [head, *(_cells(name, p) for name, p in result["parameters"].items())]
    lines = [f"{result['task']}: " + ", ".join(f"run {i} {result['runs'][i - 1]}" for i in runs)]
    notes = (f"note: {note}" for note in result["notes"])
    return [*lines, *aligned(rows, left=[0]), *notes, _says(result)]


def _cells(name: str, p: dict[str, Any]) -> tuple[str, ...]:
    cells = [name]
    for estimate in p["estimates"]:
        mean, low, high = (estimate[key] for key in ("mean", "low", "high"))
        cells += [within(mean, low, high), interval(estimate)]
    return (*cells, f"{p['difference_std']:+.1f} std")


def _says(result: dict[str, Any]) -> str:
    name, limit = result["largest"], result["limit_std"]
    largest = abs(result["parameters"][name]["difference_std"])
    num = len(result["parameters"])
    of_all = f"the largest of {num} differences" if num > 1 else "the difference"
    rate = f"{100 * result['false_alarm_rate']:g} %"
    num_told, which = len(result["told"]), "both" if len(result["runs"]) == 2 else "all"
    says = "The runs agree" if result["agree"] else "The runs disagree"
    if result["agree"] and not num_told:
        says = f"No parameter is told by {which} runs, and so nothing says that they agree"
    elif result["agree"] and num_told < num:
        says = f"In {num_told} of {counted(num, 'parameter')}, which {which} tell, the runs agree"
    return (
        f"{says}: {of_all} is {largest:.1f} "
        f"standard deviations ({name}). Above {limit:.1f} it would be in {rate} of "
        f"{'pairs' if len(result['runs']) == 2 else 'sets'} of runs of one world, if all intervals "
        "are right."
    )
