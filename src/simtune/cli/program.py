"""The program: parses the command line, runs the command, and returns an exit status."""

import json
import os
import signal
import sys
import time
import warnings
from io import TextIOWrapper
from typing import Any

import simtune
from simtune.cli.parse import parse
from simtune.cli.run import check_first, run
from simtune.columns import counted
from simtune.config import EvaluateConfig, SweepConfig, TrainConfig, TuneConfig
from simtune.errors import InputError
from simtune.threads import wait_passively


def main() -> None:
    """Exit status: 0 done, 1 failed, 2 unusable input (one line says why), 130 Ctrl-C."""
    wait_passively()
    began_s = time.time()
    typed = sys.argv[1:]
    command = None
    _make_writable()
    warnings.showwarning = _TellOnce()
    try:
        if typed == ["--version"]:
            print(f"simtune {simtune.__version__}")
        else:
            command = parse(typed)
            _carry_out(command)
        sys.stdout.flush()
    except InputError as error:
        sys.exit(_complain(error, 2))
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # an impatient second one would be a traceback
        status = _complain(_interrupted(command, began_s), 130)
        if not _is_torch_loaded():
            sys.stdout.flush()
            os._exit(status)  # a library that is loaded by half may crash as Python ends
        sys.exit(status)
    except BrokenPipeError:  # `simtune tasks | head -1`: the reader has stopped reading
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # else Python complains when closing stdout
        sys.exit(1)
    except MemoryError as error:
        sys.exit(_complain(f"out of memory: {error}", 1))
    except (RuntimeError, OSError) as error:
        sys.exit(_complain(error, 1))


def _make_writable() -> None:
    """Let whatever is printed pass: "?" for what stdout's encoding lacks, nothing where closed."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the shell: >&-
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))
    if isinstance(sys.stdout, TextIOWrapper):  # stderr never fails so: Python has it escape
        sys.stdout.reconfigure(errors="replace")


class _TellOnce:
    """Prints what libraries warn of: once each, without a line of their own or of ours.

    MuJoCo says what is deprecated in a model whenever that is compiled.
    """

    def __init__(self) -> None:
        self._told = set[str]()

    def __call__(self, message: Warning | str, *_: Any, **__: Any) -> None:
        text = " ".join(str(message).split())
        if text not in self._told:
            self._told.add(text)
            print(f"warning: {text}", file=sys.stderr, flush=True)


def _carry_out(command: Any) -> None:
    """Check and run a command. Raises RuntimeError for a failure, after printing everything."""
    check_first(command)
    result = run(command, _print_nothing if command.json else _print_line)
    is_score = isinstance(command, EvaluateConfig) and command.real is None
    if command.json or is_score:
        from simtune.run.files import plain

        print(json.dumps(plain(result.content)))
    if result.failure:
        raise RuntimeError(result.failure)


def _print_line(line: str) -> None:
    print(line, flush=True)


def _print_nothing(_: str) -> None:
    """Used with --json, which prints one JSON object instead of lines."""


def _interrupted(command: Any, began_s: float) -> str:
    """A message that tells what is kept of an interrupted run, and what is lost."""
    if isinstance(command, SweepConfig):
        return "interrupted; the same command goes on"
    if not isinstance(command, TuneConfig | TrainConfig):
        return "interrupted"
    if not _is_torch_loaded():  # no work begins before
        return "interrupted before it began: nothing is lost"
    from simtune.report.words import duration
    from simtune.run.kept import kept_since, kept_state

    state = kept_state(command.out)
    lost = duration(time.time() - max(began_s, kept_since(command.out) or 0.0))
    if not state:
        return (
            f"interrupted before there was anything to keep: its {lost} are lost, and the same "
            "command begins anew"
        )
    kept = counted(state["rounds"], "finished round")
    on = ""
    if isinstance(command, TrainConfig):
        kept += f" and {counted(state['step'], 'step')} of the policy's training"
        lost = f"the last {lost}"
    else:
        is_within = state.get("is_within")
        kept += " and the next one's detector" * bool(is_within)
        lost = f"what came after, {lost}" if is_within else f"the round in progress, {lost}"
        on = "; with --budget-minutes 1 it ends with what there is" * bool(state["rounds"])
    return f"interrupted; kept: {kept}; lost: {lost}; the same command goes on from there{on}"


def _is_torch_loaded() -> bool:
    """Python forgets a module whose import did not end."""
    return "torch" in sys.modules


def _complain(what: object, status: int) -> int:
    print(f"simtune: {' '.join(str(what).split())}", file=sys.stderr)
    return status
