"""How far an agent is: what it explored, what was collected, how often it learnt."""

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(kw_only=True)
class Counter:
    """Steps are those of all worlds together. The first `random_steps` are for random actions."""

    random_steps: int
    update_every: int  # steps
    num_explored: int = 0
    num_collected: int = 0
    num_updates: int = 0

    def explore(self, num_worlds: int) -> bool:
        """Count a step in each world; whether it is to be a random one."""
        is_random = self.num_explored < self.random_steps
        self.num_explored += num_worlds
        return is_random

    def collect(self, num_steps: int) -> int:
        """Count new steps; the number of updates that are due for them."""
        before = self._num_due()
        self.num_collected += num_steps
        return self._num_due() - before

    def _num_due(self) -> int:
        return max(self.num_collected - self.random_steps, 0) // self.update_every

    def state(self) -> dict[str, Any]:
        """The counts; JSON."""
        return {name: value for name, value in asdict(self).items() if name.startswith("num_")}

    def load(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        for name in self.state():
            setattr(self, name, state[name])
