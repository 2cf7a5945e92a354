"""One run's folder: created or resumed, its checkpoints and results.

config.json          the resolved configuration, versions, date
sources/             copies of the tuning file, the model and all files that they name
metrics.jsonl        one object per line: step, real_episodes, wall_s, then scalars
events.jsonl         ranges that widened, narrowed or moved, and why
tensorboard/         the same scalars
checkpoints/NNNNNN/  the latest two states, for resuming
real/NNN.safetensors trajectories that a training filmed in the real world
result.json  curves.json  posterior.npz  replay.json  videos/  report.html
"""

import fcntl
import io
import logging
import os
import weakref
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import torch

from simtune.errors import InputError
from simtune.run import checkpoint
from simtune.run.files import plain, write_atomically, write_json
from simtune.run.kept import CHECKPOINTS, stored_run
from simtune.run.logs import RunLogs
from simtune.run.sources import keep_sources, named_sources
from simtune.run.versions import changed_versions, versions

_NUM_LINES = "log_lines"  # key of {log: number of lines} in a checkpoint's state

log = logging.getLogger(__name__)


class RunFolder:
    """A run's folder, opened for writing by one process; use `RunFolder.create`."""

    def __init__(self, path: Path, resumed: bool):
        self.path = path
        self.resumed = resumed
        self._content = dict[str, Any]()  # of config.json
        self._unlock = weakref.finalize(self, os.close, _lock(path))
        self._newest = checkpoint.newest(self._checkpoints)
        state = checkpoint.load_state(self._newest) if self._newest else {}
        checkpoint.drop_after(self._checkpoints, self._newest)
        after_step = state.get("step", -1) if resumed else None
        self.logs = RunLogs(path, state.get(_NUM_LINES, {}), after_step)

    @classmethod
    def create(
        cls, path: Path | str, config: Mapping[str, Any], sources: Sequence[Path] = ()
    ) -> "RunFolder":
        """Start a run at `path`, or resume the run of the same `config` there.

        A resumed run drops the log lines after its last checkpoint, since they are written again.
        Its place and duration may have changed: see `write_config`. A new run keeps copies of
        `sources`, the files that its task was read from. Raises InputError if the path cannot be
        written, or holds something else, a run with another configuration, or one that is still
        going.
        """
        path = Path(path)
        try:
            stored = stored_run(path, config)
            path.mkdir(parents=True, exist_ok=True)
            run = cls(path, resumed=stored is not None)
            root = (stored or {}).get("sources") or keep_sources(path, sources)
            run._content = _content(path, plain(config), stored, root)
            if stored is None:
                run.write_config()
        except OSError as error:
            raise InputError(f"cannot write the run folder {path}: {error.strerror}") from error
        return run

    def write_config(self) -> None:
        """Replace config.json. Of a resumed run: once its checkpoint is loaded.

        Otherwise a run that these versions cannot load would say that they made it.
        """
        write_json(self.path / "config.json", self._content)

    @property
    def videos(self) -> Path:
        """The folder for real.mp4, before.mp4 and after.mp4; made if missing."""
        path = self.path / "videos"
        path.mkdir(exist_ok=True)
        return path

    @property
    def _checkpoints(self) -> Path:
        return self.path / CHECKPOINTS

    def write_result(self, result: Mapping[str, Any]) -> None:
        """Replace result.json."""
        write_json(self.path / "result.json", result)

    def write_curves(self, curves: Mapping[str, Mapping[str, Any]]) -> None:
        """Replace curves.json: {name: {"candidates": (n,), "prob_higher": (n,)}}."""
        write_json(self.path / "curves.json", curves)

    def write_replay(self, curves: Mapping[str, Any]) -> None:
        """Replace replay.json: readings of an episode, and the simulator's readings."""
        write_json(self.path / "replay.json", curves)

    def write_posterior(
        self, names: Sequence[str], draws: np.ndarray, correlation: np.ndarray
    ) -> None:
        """Replace posterior.npz: N names, (num, N) draws in the parameters' units, and the copula's
        (N, N) correlation.
        """
        file = io.BytesIO()
        np.savez_compressed(file, names=np.array(names), draws=draws, correlation=correlation)
        write_atomically(self.path / "posterior.npz", file.getvalue())

    def save_checkpoint(
        self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]
    ) -> None:
        """Save everything that the run needs to resume; the latest two checkpoints are kept.

        `state` is JSON and contains "step", at which tensorboard continues. A resumed run cuts the
        logs to their current length.
        """
        assert "step" in state, "a checkpoint's state needs 'step'"
        self.logs.sync()  # before the checkpoint that counts their lines
        state = {**state, _NUM_LINES: self.logs.num_lines}
        self._newest = checkpoint.save(self._checkpoints, tensors, state)

    def load_checkpoint(self) -> tuple[dict[str, torch.Tensor], dict[str, Any]] | None:
        """(tensors on the CPU, state) of the newest sound checkpoint; None if there is none."""
        if self._newest is None:
            return None
        tensors, state = checkpoint.load(self._newest)
        del state[_NUM_LINES]
        return tensors, state

    def close(self) -> None:
        """Close tensorboard and unlock the folder."""
        self.logs.close()
        self._unlock()

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _content(
    path: Path, config: dict[str, Any], stored: dict[str, Any] | None, root: str | None
) -> dict[str, Any]:
    """Of config.json; `stored`: what it is now, `root`: of the sources that the run keeps."""
    if changed := changed_versions(stored or {}):
        said = ", ".join(f"{name} {change}" for name, change in changed.items())
        log.warning("%s goes on with other versions: %s", path, said)
    created = (stored or {}).get("created") or datetime.now(UTC).isoformat(timespec="seconds")
    config |= named_sources(stored or {})
    return {"config": config, "versions": versions(), "created": created, "sources": root}


def _lock(path: Path) -> int:
    """Lock the folder for this process, until the returned descriptor is closed.

    Raises InputError if another process, or another RunFolder of this process, holds the lock.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise InputError(f"{path} is being written by a run that is still going") from None
    except OSError as error:  # a file system without locks
        log.warning("%s cannot be locked (%s): keep other runs out of it", path, error.strerror)
    return descriptor
