"""The content of a run folder, read back for its report, `simtune.load` and other commands."""

from simtune.run_data.facts import POLICY_VIDEO, VIDEOS
from simtune.run_data.looked_at import RunData
from simtune.run_data.read import finished, read_finished, read_run

__all__ = ["POLICY_VIDEO", "VIDEOS", "RunData", "finished", "read_finished", "read_run"]
