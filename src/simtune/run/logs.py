"""A run's logs: metrics.jsonl and events.jsonl, and tensorboard with the same scalars."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simtune.run.files import append_jsonl, keep_lines, plain, sync

_METRICS, _EVENTS = "metrics.jsonl", "events.jsonl"


class RunLogs:
    """Logs that a resumed run cuts to what its checkpoint knows, since it writes the rest again."""

    def __init__(self, folder: Path, num_lines: Mapping[str, int], after_step: int | None):
        """Cut the logs to the `num_lines` of each that a checkpoint counted; by default none.

        `after_step`: the checkpoint's step, after which tensorboard continues; None: a new run.
        """
        self._folder, self._after_step = folder, after_step
        self._tensorboard: Any = None
        self.num_lines = dict.fromkeys((_METRICS, _EVENTS), 0) | dict(num_lines)
        for name, count in self.num_lines.items():
            keep_lines(folder / name, count)

    def log_metrics(
        self, step: int, real_episodes: int, wall_s: float, scalars: Mapping[str, float]
    ) -> None:
        """Append a line to metrics.jsonl and write the finite scalars to tensorboard.

        `step` counts simulated policy steps, `wall_s` seconds over the run and its resumptions.
        """
        line = {"step": step, "real_episodes": real_episodes, "wall_s": wall_s, **scalars}
        self._append(_METRICS, line)
        writer = self._writer()
        for name, value in plain(scalars).items():
            if isinstance(value, int | float):
                writer.add_scalar(name, value, step)
        writer.add_scalar("real_episodes", real_episodes, step)
        writer.flush()

    def log_event(self, step: int, wall_s: float, event: Mapping[str, Any]) -> None:
        """Append a line to events.jsonl: a `tuning.search.Event`, as a dict."""
        self._append(_EVENTS, {"step": step, "wall_s": wall_s, **event})

    def sync(self) -> None:
        """Force the lines onto the disk."""
        for name in self.num_lines:
            sync(self._folder / name)

    def close(self) -> None:
        """Close tensorboard."""
        if self._tensorboard is not None:
            self._tensorboard.close()
            self._tensorboard = None

    def _append(self, name: str, line: Mapping[str, Any]) -> None:
        append_jsonl(self._folder / name, line)
        self.num_lines[name] += 1

    def _writer(self) -> Any:
        if self._tensorboard is None:
            from torch.utils.tensorboard import SummaryWriter  # takes seconds to import

            # purge_step hides what was written after the checkpoint, before an interruption.
            purge_step = None if self._after_step is None else self._after_step + 1
            folder = str(self._folder / "tensorboard")
            self._tensorboard = SummaryWriter(folder, purge_step=purge_step)
        return self._tensorboard
