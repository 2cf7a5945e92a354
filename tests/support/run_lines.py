"""Lines of benchmarks/whole_runs.py, made by hand."""

from simtune.tasks import load_task

SPACE = load_task("cartpole").parameters
NAMES = SPACE.names


def whole_run(**changes):
    from whole.run import WholeRun

    asked = {"task": "cartpole", "seed": 3, "cores": 1, "minutes": 6.0, "episodes": 5}
    return WholeRun(**asked | changes)


def a_line(run=None, held=8, error=1.0, verdict="identified", warnings=(), wall_s=300.0) -> dict:
    """Of a run whose first `held` intervals hold, and that is `error` % off everywhere."""
    return (run or whole_run()).settings | {
        "commit": "1234567",
        "date": "2026-11-22",
        "wall_s": wall_s,
        "errors": dict.fromkeys(NAMES, error),
        "half_widths": dict.fromkeys(NAMES, 2.0),
        "holds": {name: i < held for i, name in enumerate(NAMES)},
        "verdicts": dict.fromkeys(NAMES, verdict),
        "warnings": list(warnings),
    }
