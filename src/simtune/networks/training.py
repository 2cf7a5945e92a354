"""One training loop for the search's networks: until all updates are done or the time is over."""

import math
from collections import deque
from collections.abc import Callable

import torch
from torch import nn

from simtune.budget import NO_LIMIT, Budget
from simtune.networks.cuda_graph import graphed, make_capturable, set_rate

_WARM_UP_UPDATES = 50
_REPORT_EVERY_UPDATES = 20
_AVERAGED_LOSSES = 50  # the last ones, whose mean is logged


class TrainingClock:
    """Progress of a training, by updates or by time, whichever is further.

    Time does not count before `least_updates`: an untrained network would be confidently wrong.
    """

    def __init__(
        self,
        num_updates: int,
        budget: Budget = NO_LIMIT,
        doing: str = "training",
        least_updates: int = 1,
    ):
        self._num_updates, self._budget, self._doing = num_updates, budget, doing
        self._least_updates = min(least_updates, num_updates)
        self.updates = 0

    def step(self) -> None:
        """Count an update."""
        self.updates += 1
        if self.updates % _REPORT_EVERY_UPDATES == 0:
            self._budget.report(self._doing, self.fraction)

    @property
    def fraction(self) -> float:
        """Share of the training that is over; 1 or more at its end."""
        in_time = min(self._budget.spent, self.updates / self._least_updates)
        return max(self.updates / self._num_updates, in_time)

    def learning_rate(self, peak: float) -> float:
        """A short warm-up, then linear to zero."""
        return peak * min(1.0, (self.updates + 1) / _WARM_UP_UPDATES) * max(0.01, 1 - self.fraction)


def train_network(
    network: nn.Module,
    draw_loss: Callable[[], torch.Tensor],
    clock: TrainingClock,
    learning_rate: float,
    *,
    weight_decay: float = 1e-2,
    largest_gradient: float | None = None,
    graph_with: torch.Generator | None = None,
) -> float:
    """Update `network` by AdamW on losses of freshly drawn batches; returns the last ones' mean.

    `largest_gradient`: the norm to which gradients are clipped. `graph_with`: whose random numbers
    `draw_loss` takes; on a GPU the update becomes a CUDA graph, for which all shapes must stay.
    """
    optimizer = torch.optim.AdamW(network.parameters(), learning_rate, weight_decay=weight_decay)
    make_capturable(optimizer, next(network.parameters()).device)

    def update() -> torch.Tensor:
        loss = draw_loss()
        optimizer.zero_grad()
        loss.backward()
        if largest_gradient is not None:
            nn.utils.clip_grad_norm_(network.parameters(), largest_gradient)
        optimizer.step()
        return loss.detach()

    step = graphed(update, graph_with) if graph_with else update
    losses = deque(maxlen=_AVERAGED_LOSSES)
    while clock.fraction < 1:
        set_rate(optimizer, clock.learning_rate(learning_rate))
        losses.append(step().clone())  # a graph reuses its output's memory
        clock.step()
    return float(torch.stack([*losses]).mean()) if losses else math.nan
