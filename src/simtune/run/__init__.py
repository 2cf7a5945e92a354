"""The run folder: configuration, logs, and checkpoints for resuming."""

from simtune.run.files import plain, read_json, read_jsonl, write_atomically, write_json
from simtune.run.folder import RunFolder

__all__ = ["RunFolder", "plain", "read_json", "read_jsonl", "write_atomically", "write_json"]
