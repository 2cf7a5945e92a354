"""How sure the numbers are that `simtune export` writes."""

from pathlib import Path

from simtune.columns import counted
from simtune.run_data import read_finished


def how_sure(run_folder: Path) -> list[str]:
    """Lines: which parameters of a run are identified, which are not, and the run's warnings."""
    run = read_finished(run_folder)
    result = run.result
    by_verdict: dict[str, list[str]] = {}
    for name, its in result["parameters"].items():
        verdict = "known" if name in run.known else its.get("verdict")
        by_verdict.setdefault(verdict or "without a verdict", []).append(name)
    num = counted(len(result["parameters"]), "parameter")
    identified = len(by_verdict.pop("identified", ()))
    others = (f"{verdict}: {', '.join(names)}" for verdict, names in by_verdict.items())
    warnings = (f"warning: {warning}" for warning in result.get("warnings", ()))
    return [f"{identified} of {num} identified", *others, *warnings]
