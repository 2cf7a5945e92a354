"""Commands that make runs or read them."""

import shlex
import sys
import time
import webbrowser
from pathlib import Path
from typing import Any

from simtune.cli.commands import ReportCommand
from simtune.cli.outcome import CommandResult, PrintLine, quoted
from simtune.columns import counted
from simtune.config import (
    UNTUNED,
    CompareConfig,
    EvaluateConfig,
    ExportConfig,
    FiguresConfig,
    SweepConfig,
    TrainConfig,
    TuneConfig,
)

_NO_RECORDINGS = (
    "NO RECORDINGS ARE GIVEN, so this tunes to a simulated truth: --real DIR tunes to yours "
    "(docs/recordings.md)"
)


def tune(config: TuneConfig, print_line: PrintLine) -> CommandResult:
    from simtune.experiment.finished import finished_result
    from simtune.progress import ProgressBar

    if not any(word.partition("=")[0] == "--real" for word in sys.argv):
        print(_NO_RECORDINGS, file=sys.stderr, flush=True)
    began_s = time.monotonic()
    with ProgressBar(60 * config.budget_minutes) as progress:
        result = finished_result(config)
        if result is None:
            from simtune.tuning_run import tune  # and torch: up to 20 s on a busy machine

            loading_s = time.monotonic() - began_s
            result = tune(config, progress, command=_command(), loading_s=loading_s)
    return _print_result(result, config.out, print_line)


def train(config: TrainConfig, print_line: PrintLine) -> CommandResult:
    from simtune.algorithm import train
    from simtune.progress import ProgressBar

    with ProgressBar() as progress:
        result = train(config, progress, command=_command())
    return _print_result(result, config.out, print_line)


def _print_result(result: dict[str, Any], out: Path, print_line: PrintLine) -> CommandResult:
    """Print the estimates if there are any, all warnings, and a policy's scores."""
    from simtune.api.table import lines
    from simtune.names import search_traits
    from simtune.report.trust import mean_error, num_holding
    from simtune.report.words import number
    from simtune.run_data import read_run

    if result["method"] not in UNTUNED:
        print_line("\n".join(lines(run := read_run(out))))
        if (error := mean_error(run.searched)) is not None:
            print_line(f"mean error {error:.1f} %")
        if not search_traits(result["search"]).has_intervals:
            print_line('no intervals by this search: "weak" says only that it moved the estimate')
        elif (held := num_holding(run.searched))[1]:
            print_line("{} of {} intervals hold the truth".format(*held))
    for warning in result["warnings"]:
        print_line(f"warning: {warning}")
    if "return" in result:
        score = result["return"]
        scored = counted(score["episodes"], "episode")
        print_line(f"return {number(score['mean'])} ± {number(score['std'])} in {scored}")
    elif "policy_steps" in result:  # a training for a world that cannot be played
        found = quoted(out / "result.json")
        print_line(
            "the policy's return in the recorded world is not known; in the simulator that was "
            f"found: simtune evaluate {quoted(out)} --parameters {found}"
        )
    for goal in ("success", "near_success"):
        if goal in result:
            print_line(f"{goal.replace('_', ' ')} in {100 * result[goal]['mean']:.0f} % of them")
    report = str(out / "report.html")
    print_line(f"\nreport: {report}")
    return CommandResult(result | {"report": report})


def _command() -> str:
    """The command line, as stored in result.json."""
    return shlex.join(["simtune", *sys.argv[1:]])


def evaluate(config: EvaluateConfig, print_line: PrintLine) -> CommandResult:
    from simtune.evaluation.evaluate import evaluate
    from simtune.evaluation.table import table

    result = evaluate(config)
    if config.real is not None:
        print_line("\n".join(table(result)))
    return CommandResult(result)


def export(config: ExportConfig, print_line: PrintLine) -> CommandResult:
    from simtune.export import export, how_sure

    out = export(config)
    what = f"{out / 'model.xml'}, with its numbers in parameters.json and apply.py"
    what += ", and samples.csv" * bool(config.samples)
    what += f", and {config.format}_worlds.py" * (config.format != "samples")
    lines = [str(out)] if config.is_file else [what, *how_sure(config.run_folder)]
    print_line("\n".join(lines))
    files = [out] if config.is_file else sorted(path for path in out.rglob("*") if path.is_file())
    return CommandResult({"files": [str(path) for path in files]})


def compare(config: CompareConfig, print_line: PrintLine) -> CommandResult:
    from simtune.compare import compare, table

    result = compare(config)
    print_line("\n".join(table(result)))
    return CommandResult(result)


def report(command: ReportCommand, print_line: PrintLine) -> CommandResult:
    from simtune.report import write_report

    page = write_report(command.run_folder)
    print_line(str(page))
    result = {"report": str(page)}
    if command.rerun:
        from simtune.report.rerun_file import write_rerun

        write_rerun(command.run_folder, command.rerun)
        print_line(str(command.rerun))
        result["rerun"] = str(command.rerun)
    if command.open:
        webbrowser.open(page.resolve().as_uri())
    return CommandResult(result)


def sweep(config: SweepConfig, print_line: PrintLine) -> CommandResult:
    from simtune.sweep import dry_run, sweep

    if config.dry_run:
        return CommandResult({"seconds_left": dry_run(config, print_line)})
    standings = sweep(config)
    result = {name: standing.status for name, standing in standings.items()}
    failed = [name for name, status in result.items() if status == "failed"]
    if failed:
        return CommandResult(
            result,
            f"{len(failed)} of {counted(len(standings), 'run')} failed: {', '.join(failed)}; "
            f"{config.out / 'sweep.json'} has the reasons",
        )
    print_line(f"{counted(len(standings), 'run')} done; next: simtune figures {quoted(config.out)}")
    return CommandResult(result)


def figures(config: FiguresConfig, print_line: PrintLine) -> CommandResult:
    from simtune.figures import write_figures

    page = write_figures(config.folder)
    print_line(str(page))
    return CommandResult({"figures": str(page)})
