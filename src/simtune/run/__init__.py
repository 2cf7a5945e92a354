"""The run folder: what was asked, what was measured, and where to go on from."""

from simtune.run.files import read_json, read_jsonl, write_atomically, write_json
from simtune.run.folder import RunFolder

__all__ = ["RunFolder", "read_json", "read_jsonl", "write_atomically", "write_json"]
