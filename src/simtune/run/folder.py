"""One run's folder: created or resumed, logged into, saved and loaded.

config.json          the resolved configuration, versions, date
sources/             copies of the tuning file, the model and all files that they name
metrics.jsonl        one object per line: step, real_episodes, wall_s, then scalars
events.jsonl         ranges that widened, narrowed or moved, and why
tensorboard/         the same scalars
checkpoints/NNNNNN/  the latest two states, for resuming
real/NNN.safetensors trajectories that a training filmed in the real world
result.json  curves.json  posterior.npz  videos/  report.html
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
import safetensors.torch
import torch

from simtune.errors import InputError
from simtune.networks.layers import under
from simtune.run import checkpoint
from simtune.run.config import check_same, stored_config
from simtune.run.files import (
    append_jsonl,
    keep_lines,
    plain,
    sync,
    write_atomically,
    write_json,
)
from simtune.run.sources import keep_sources, named_sources
from simtune.run.versions import changed_versions, versions
from simtune.trajectory import Trajectory

POSTERIOR = "posterior.npz"
REPLAY = "replay.json"
_CHECKPOINTS = "checkpoints"
_LOGS = ("metrics.jsonl", "events.jsonl")
_NUM_LINES = "log_lines"  # key of {log: number of lines} in a checkpoint's state

log = logging.getLogger(__name__)


class RunFolder:
    """A run's folder, opened for writing by one process; use `RunFolder.create`."""

    def __init__(self, path: Path, resumed: bool):
        self.path = path
        self.resumed = resumed
        self._tensorboard: Any = None
        self._unlock = weakref.finalize(self, os.close, _lock(path))
        self._newest = checkpoint.newest(self._checkpoints)
        state = checkpoint.load_state(self._newest) if self._newest else {}
        self._step: int = state.get("step", -1)
        checkpoint.drop_after(self._checkpoints, self._newest)
        self._num_lines: dict[str, int] = state.get(_NUM_LINES, dict.fromkeys(_LOGS, 0))
        for name, count in self._num_lines.items():
            keep_lines(path / name, count)

    @classmethod
    def create(
        cls, path: Path | str, config: Mapping[str, Any], sources: Sequence[Path] = ()
    ) -> "RunFolder":
        """Start a run at `path`, or resume the run of the same `config` there.

        A resumed run drops the log lines after its last checkpoint, since they are written again.
        Its place and duration may have changed. A new run keeps copies of `sources`, the files that
        its task was read from. Raises InputError if the path cannot be written, or holds something
        else, a run with another configuration, or a run that is still going.
        """
        path = Path(path)
        try:
            stored = _stored_run(path, config)
            path.mkdir(parents=True, exist_ok=True)
            run = cls(path, resumed=stored is not None)
            root = (stored or {}).get("sources") or keep_sources(path, sources)
            run._write_config(plain(config), stored, root)
        except OSError as error:
            raise InputError(f"cannot write the run folder {path}: {error.strerror}") from error
        return run

    def _write_config(
        self, config: dict[str, Any], stored: dict[str, Any] | None, root: str | None
    ) -> None:
        if changed := changed_versions(stored or {}):
            said = ", ".join(f"{name} {change}" for name, change in changed.items())
            log.warning("%s goes on with other versions: %s", self.path, said)
        created = (stored or {}).get("created") or datetime.now(UTC).isoformat(timespec="seconds")
        config |= named_sources(stored or {})
        content = {"config": config, "versions": versions(), "created": created, "sources": root}
        write_json(self.path / "config.json", content)

    @property
    def videos(self) -> Path:
        """The folder for real.mp4, before.mp4 and after.mp4; made if missing."""
        path = self.path / "videos"
        path.mkdir(exist_ok=True)
        return path

    @property
    def _checkpoints(self) -> Path:
        return self.path / _CHECKPOINTS

    def log_metrics(
        self, step: int, real_episodes: int, wall_s: float, scalars: Mapping[str, float]
    ) -> None:
        """Append a line to metrics.jsonl and write the finite scalars to tensorboard.

        `step` counts simulated policy steps, `wall_s` seconds over the run and its resumptions.
        """
        line = {"step": step, "real_episodes": real_episodes, "wall_s": wall_s, **scalars}
        self._append("metrics.jsonl", line)
        writer = self._writer()
        for name, value in plain(scalars).items():
            if isinstance(value, int | float):
                writer.add_scalar(name, value, step)
        writer.add_scalar("real_episodes", real_episodes, step)
        writer.flush()

    def log_event(
        self,
        step: int,
        wall_s: float,
        event: str,
        parameter: str,
        low: float,
        high: float,
        reason: str,
    ) -> None:
        """Append a line to events.jsonl: `parameter`'s range is now [low, high] because `reason`.

        `event` is "widened", "narrowed" or, if the mean has reached a bound, "moved".
        """
        line = {"step": step, "wall_s": wall_s, "event": event, "parameter": parameter}
        self._append("events.jsonl", {**line, "low": low, "high": high, "reason": reason})

    def _append(self, name: str, line: Mapping[str, Any]) -> None:
        append_jsonl(self.path / name, line)
        self._num_lines[name] += 1

    def write_result(self, result: Mapping[str, Any]) -> None:
        """Replace result.json."""
        write_json(self.path / "result.json", result)

    def write_curves(self, curves: Mapping[str, Mapping[str, Any]]) -> None:
        """Replace curves.json: {name: {"candidates": (n,), "prob_higher": (n,)}}."""
        write_json(self.path / "curves.json", curves)

    def write_replay(self, curves: Mapping[str, Any]) -> None:
        """Replace replay.json: readings of an episode, and the simulator's readings."""
        write_json(self.path / REPLAY, curves)

    def write_posterior(
        self, names: Sequence[str], draws: np.ndarray, correlation: np.ndarray
    ) -> None:
        """Replace posterior.npz: N names, (num, N) draws in the parameters' units, and the copula's
        (N, N) correlation.
        """
        file = io.BytesIO()
        np.savez_compressed(file, names=np.array(names), draws=draws, correlation=correlation)
        write_atomically(self.path / POSTERIOR, file.getvalue())

    def write_real(self, cycle: int, trajectories: Sequence[Trajectory]) -> None:
        """Store real trajectories, which cannot be filmed again."""
        tensors = {}
        for i, trajectory in enumerate(trajectories):
            tensors[f"{i}.frames"] = torch.from_numpy(np.ascontiguousarray(trajectory.frames))
            tensors[f"{i}.actions"] = torch.from_numpy(np.ascontiguousarray(trajectory.actions))
            for name, values in trajectory.readings.items():
                tensors[f"{i}.readings.{name}"] = torch.from_numpy(np.ascontiguousarray(values))
        (self.path / "real").mkdir(exist_ok=True)
        write_atomically(self._real(cycle), safetensors.torch.save(tensors))

    def read_real(self, cycle: int, step_s: float) -> list[Trajectory]:
        """The inverse of `write_real`. Raises InputError if the file is damaged."""
        path = self._real(cycle)
        try:
            tensors = safetensors.torch.load_file(path)
        except (OSError, safetensors.SafetensorError) as error:
            raise InputError(
                f"{path} is damaged ({error}), and what it showed cannot be filmed again: "
                "give another --out to start anew"
            ) from None
        count = sum(name.split(".")[1:] == ["actions"] for name in tensors)
        return [_trajectory(under(f"{i}.", tensors), step_s) for i in range(count)]

    def _real(self, cycle: int) -> Path:
        return self.path / "real" / f"{cycle:03d}.safetensors"

    def save_checkpoint(
        self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]
    ) -> None:
        """Save everything that the run needs to resume; the latest two checkpoints are kept.

        `state` is JSON and contains "step", at which tensorboard continues. A resumed run cuts the
        logs to their current length.
        """
        assert "step" in state, "a checkpoint's state needs 'step'"
        for name in _LOGS:
            sync(self.path / name)  # logs are on the disk before the checkpoint that counts them
        self._newest = checkpoint.save(
            self._checkpoints, tensors, {**state, _NUM_LINES: self._num_lines}
        )

    def load_checkpoint(self) -> tuple[dict[str, torch.Tensor], dict[str, Any]] | None:
        """(tensors on the CPU, state) of the newest sound checkpoint; None if there is none."""
        if self._newest is None:
            return None
        tensors, state = checkpoint.load(self._newest)
        del state[_NUM_LINES]
        return tensors, state

    def close(self) -> None:
        """Close tensorboard and unlock the folder."""
        if self._tensorboard is not None:
            self._tensorboard.close()
            self._tensorboard = None
        self._unlock()

    def __enter__(self) -> "RunFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _writer(self) -> Any:
        if self._tensorboard is None:
            from torch.utils.tensorboard import SummaryWriter  # takes seconds to import

            # purge_step hides what was written after the checkpoint, before an interruption.
            self._tensorboard = SummaryWriter(
                str(self.path / "tensorboard"), purge_step=self._step + 1 if self.resumed else None
            )
        return self._tensorboard


def stored_state(path: Path, config: Mapping[str, Any]) -> dict[str, Any] | None:
    """The state from which `RunFolder.create` would resume; None: a new run. Writes nothing.

    Raises InputError like `create`.
    """
    try:
        if _stored_run(path, config) is None:
            return None
        return kept_state(path)  # `create` warns of damaged checkpoints
    except OSError as error:
        raise InputError(f"cannot read the run folder {path}: {error.strerror}") from error


def kept_state(path: Path) -> dict[str, Any] | None:
    """The state of a run's newest sound checkpoint; None if there is none."""
    newest = checkpoint.newest(path / _CHECKPOINTS, warn=False)
    return checkpoint.load_state(newest) if newest else None


def kept_since(path: Path) -> float | None:
    """Time of the newest sound checkpoint, in seconds since 1970; None if there is none."""
    newest = checkpoint.newest(path / _CHECKPOINTS, warn=False)
    return newest.stat().st_mtime if newest else None


def _stored_run(path: Path, config: Mapping[str, Any]) -> dict[str, Any] | None:
    """config.json of the run at `path`; None: a new run. Raises InputError if `config` differs."""
    stored = stored_config(path)
    if stored is not None:
        check_same(path, stored, plain(config))
    return stored


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


def _trajectory(tensors: Mapping[str, torch.Tensor], step_s: float) -> Trajectory:
    readings = {name: values.numpy() for name, values in under("readings.", tensors).items()}
    return Trajectory(tensors["frames"].numpy(), tensors["actions"].numpy(), step_s, readings)
