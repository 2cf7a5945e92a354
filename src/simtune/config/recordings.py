"""The options of every command that takes recordings."""

from dataclasses import dataclass

from simtune.config.checks import flag
from simtune.errors import InputError


@dataclass(frozen=True, kw_only=True)
class RecordingsConfig:
    """How recordings (docs/recordings.md) are read."""

    camera: str | None = None
    """The recordings' camera, such as observation.images.front; needed where there are several."""
    actions: str | None = None
    """Which of the recordings' actions, NAME,NAME,..., in the order of the model's; by default
    all."""
    control_hz: float | None = None
    """Steps a second to bring recordings to; by default the rate that they were made at."""

    @property
    def action_names(self) -> tuple[str, ...] | None:
        if self.actions is None:
            return None
        return tuple(name.strip() for name in self.actions.split(","))

    def check_recordings(self, given: bool) -> None:
        """Raises InputError for what makes no sense, `given` recordings or none."""
        for name in ("camera", "actions", "control_hz"):
            if getattr(self, name) is not None and not given:
                raise InputError(f"{flag(name)} goes with recordings only")
        if self.control_hz is not None and not 0.01 <= self.control_hz <= 1000:
            raise InputError(f"--control-hz must lie in [0.01, 1000], got {self.control_hz:g}")
