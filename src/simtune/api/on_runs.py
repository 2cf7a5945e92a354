"""What commands do with finished runs: compare them, and score them on other episodes."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike, fspath
from os.path import expanduser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from simtune.api.arrays import Episode, write_arrays
from simtune.api.shown import Shown
from simtune.api.spelling import in_python
from simtune.config import CompareConfig, EvaluateConfig, check_paths, check_types
from simtune.errors import InputError
from simtune.run.config import FILMED
from simtune.run.files import plain
from simtune.threads import wait_passively

Recordings = str | PathLike[str] | Sequence[Episode] | None
Values = str | PathLike[str] | Mapping[str, Any] | None  # of parameters: a JSON file, or {name: v}


def compare_runs(folders: Sequence[Path]) -> Shown:
    """Whether runs agree, shown as the table of `simtune compare`."""
    from simtune.compare import compare, table

    with in_python():
        config = CompareConfig(run_folders=tuple(folders))
        check_paths(config)
        found = compare(config)
    return Shown(found, table(found))


def evaluate_run(
    folder: Path, real: Recordings, parameters: Values, options: Mapping[str, Any]
) -> dict[str, Any]:
    """A policy's scores; with `real`, how well it is replayed, shown as `simtune evaluate` does."""
    wait_passively()
    with in_python(), as_file(parameters) as file, TemporaryDirectory() as written:
        if real is not None and not isinstance(real, str | PathLike):
            real = write_arrays(real, Path(written, FILMED))
        given = {"real": real and Path(expanduser(real)), "parameters": file, **options}
        check_types(EvaluateConfig, given)
        config = EvaluateConfig(run_folder=folder, **given)
        config.check()
        check_paths(config)
        from simtune.evaluation.evaluate import evaluate
        from simtune.evaluation.table import table

        found = evaluate(config)
    return found if real is None else Shown(found, table(found))


@contextmanager
def as_file(values: Values) -> Iterator[Path | None]:
    """A JSON file of parameters' values; those of a dict are written, for as long as it is used.

    A dict is {name: value}, or what a run estimates, `Result.parameters`.
    """
    if not isinstance(values, Mapping):
        yield None if values is None else Path(expanduser(fspath(values)))
        return
    with TemporaryDirectory() as folder:
        file = Path(folder, "parameters.json")
        content = {"parameters": plain(values.get("parameters", values))}
        file.write_text(json.dumps(content, default=repr), encoding="utf-8")
        try:
            yield file
        except InputError as error:
            error.args = (str(error).replace(str(file), "parameters"),)
            raise
