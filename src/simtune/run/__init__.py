"""The run folder: its configuration, its logs, and the checkpoints to go on from."""

from simtune.run.files import plain, read_json, read_jsonl, write_atomically, write_json
from simtune.run.folder import RunFolder

__all__ = ["RunFolder", "plain", "read_json", "read_jsonl", "write_atomically", "write_json"]
