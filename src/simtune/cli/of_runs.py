"""Commands that make runs or read them."""

import shlex
import sys
import webbrowser
from pathlib import Path
from typing import Any

from simtune.cli.commands import ReportCommand
from simtune.cli.done import Done, Say, quoted
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


def tune(config: TuneConfig, say: Say) -> Done:
    from simtune.progress import ProgressBar
    from simtune.tuning_run import tune

    if not any(word.partition("=")[0] == "--real" for word in sys.argv):
        print(_NO_RECORDINGS, file=sys.stderr, flush=True)
    with ProgressBar(60 * config.budget_minutes) as progress:
        result = tune(config, progress, command=_command())
    return _say_result(result, config.out, say)


def train(config: TrainConfig, say: Say) -> Done:
    from simtune.algorithm import train
    from simtune.progress import ProgressBar

    with ProgressBar() as progress:
        result = train(config, progress, command=_command())
    return _say_result(result, config.out, say)


def _say_result(result: dict[str, Any], out: Path, say: Say) -> Done:
    """Print the estimates if there are any, all warnings, and a policy's scores."""
    from simtune.api.table import lines
    from simtune.report.trust import num_holding
    from simtune.report.words import number

    if result["method"] not in UNTUNED:
        say("\n".join(lines(result["parameters"], result["search"])))
        if "percent_error" in result:
            say(f"mean error {result['percent_error']:.1f} %")
        if result["search"] != "posterior":
            say('no intervals by this search: "weak" says only that it moved the estimate')
        elif (held := num_holding(result["parameters"]))[1]:
            say("{} of {} intervals hold the truth".format(*held))
    for warning in result["warnings"]:
        say(f"warning: {warning}")
    if "return" in result:
        score = result["return"]
        scored = counted(score["episodes"], "episode")
        say(f"return {number(score['mean'])} ± {number(score['std'])} in {scored}")
    for goal in ("success", "near_success"):
        if goal in result:
            say(f"{goal.replace('_', ' ')} in {100 * result[goal]['mean']:.0f} % of them")
    report = str(out / "report.html")
    say(f"\nreport: {report}")
    return Done(result | {"report": report})


def _command() -> str:
    """The command line, as stored in result.json."""
    return shlex.join(["simtune", *sys.argv[1:]])


def evaluate(config: EvaluateConfig, _: Say) -> Done:
    from simtune.evaluation.evaluate import evaluate

    return Done(evaluate(config))


def export(config: ExportConfig, say: Say) -> Done:
    from simtune.export import export

    out = export(config)
    what = f"{out / 'model.xml'}, with its numbers in parameters.json and apply.py"
    what += ", and samples.csv" * bool(config.samples)
    what += f", and {config.format}_worlds.py" * (config.format != "samples")
    say(str(out) if config.is_file else what)
    files = [out] if config.is_file else sorted(path for path in out.rglob("*") if path.is_file())
    return Done({"files": [str(path) for path in files]})


def compare(config: CompareConfig, say: Say) -> Done:
    from simtune.compare import compare, table

    result = compare(config)
    say("\n".join(table(result)))
    return Done(result)


def report(command: ReportCommand, say: Say) -> Done:
    from simtune.report import write_report

    page = write_report(command.run_folder)
    say(str(page))
    result = {"report": str(page)}
    if command.rerun:
        from simtune.report.rerun_file import write_rerun

        write_rerun(command.run_folder, command.rerun)
        say(str(command.rerun))
        result["rerun"] = str(command.rerun)
    if command.open:
        webbrowser.open(page.resolve().as_uri())
    return Done(result)


def sweep(config: SweepConfig, say: Say) -> Done:
    from simtune.sweep import dry_run, sweep

    if config.dry_run:
        return Done({"seconds_left": dry_run(config, say)})
    standings = sweep(config)
    result = {name: standing.status for name, standing in standings.items()}
    failed = [name for name, status in result.items() if status == "failed"]
    if failed:
        return Done(
            result,
            f"{len(failed)} of {counted(len(standings), 'run')} failed: {', '.join(failed)}; "
            f"{config.out / 'sweep.json'} has the reasons",
        )
    say(f"{counted(len(standings), 'run')} done; next: simtune figures {quoted(config.out)}")
    return Done(result)


def figures(config: FiguresConfig, say: Say) -> Done:
    from simtune.figures import write_figures

    page = write_figures(config.folder)
    say(str(page))
    return Done({"figures": str(page)})
