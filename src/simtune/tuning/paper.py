"""The paper's search: small steps of ξ_mean in the SPM's direction (Algorithm 1, Sec. IV-B)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from simtune.budget import Budget
from simtune.columns import episode_in_words
from simtune.errors import InputError
from simtune.networks.layers import (
    load_optimizer_tensors,
    load_weights,
    optimizer_tensors,
    seeded,
    under,
)
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.replay_buffer import Episodes, EpisodeStore
from simtune.search_param_model.paper import Method, PaperConfig, PaperSearchParamModel
from simtune.search_param_model.windows import SpmBuffer
from simtune.tasks import check_known_is_used
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import unsure
from simtune.tuning.mean_update import approach, arrivals, shift_mean
from simtune.tuning.search import NO_CALLBACKS, Callbacks, Event, Round, Search, SearchContext

_NOT_MOVED = (
    "The paper's search has not moved yet, so these are the values it started from. It moves once "
    "it has collected its first episodes and learnt from them: give it more minutes, or leave out "
    "--search paper."
)


class PaperSearch(Search):
    """Collect in Ξ, train q_φ, ask it about the real trajectories, step (search="paper").

    Sensor readings are inputs beside the pictures ("any state information accessible in both
    simulation and reality can also be concatenated", Sec. V). It gives directions and no intervals:
    `low` and `high` of its estimates are the range that is searched, ξ_mean·(1 ± range_spm), and
    each verdict is "weak". Real trajectories must be filmed at the simulator's image size;
    simulated worlds play their actions. Raises InputError for a space with values below 0, which
    proportional steps cannot search, and if a colour is known, which it would move like the others.
    """

    def __init__(
        self,
        context: SearchContext,
        config: PaperConfig | None = None,
        *,
        method: Method = "paper",
    ):
        self.config = config = config or PaperConfig()
        self.method: Method = method
        simulator = context.simulator
        if not simulator.can_start_anywhere:
            raise InputError(f"--search {method} needs a MuJoCo model; --search posterior does not")
        self.space = space = simulator.space
        if negative := [p.name for p in space if p.low < 0]:
            raise InputError(
                f"search={method!r} moves in proportion to a value, which {negative[0]} with its "
                "low below 0 cannot have; use search='posterior'"
            )
        if context.known is not None:
            known = np.isfinite(context.known)
            check_known_is_used(np.array(space.names)[known].tolist(), method)
        self.num_moves = 0
        self._simulator, self._observation = simulator, context.observation
        self._rng, self._device = stream(context.seed, Purpose.PAPER_SEARCH), context.device
        start, range_ = context.start, config.range_spm
        self.distribution = Distribution.proportional(space, start, range_, start)
        scale = simulator.action_scale
        self._store = EpisodeStore(space, filmed_capacity=config.num_kept, device=context.device)
        self._buffer = SpmBuffer(self._store, scale)
        with seeded(int(self._rng.integers(2**62))):
            self.model = PaperSearchParamModel(
                config, space, scale, method, len(context.observation.reading_labels)
            ).to(context.device)
        self._optimizer = torch.optim.Adam(
            self.model.parameters(), config.learning_rate, (config.beta1, 0.999)
        )

    @property
    def stop_reason(self) -> str:
        return "all moves are done" if self.num_moves >= self.config.max_moves else ""

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        callbacks: Callbacks = NO_CALLBACKS,
    ) -> Round:
        """See `Search`. The first rounds only pretrain and leave Ξ as it is."""
        self.check(real)
        budget.report(f"move {self.num_moves} of {self.config.max_moves}")
        config, store = self.config, self._store
        while store.num_added * config.episode_steps < config.collect_steps:
            self._collect(real)  # a world that diverges adds nothing, so count those added
            if budget.is_over:
                break
        self._collect(real)
        loss = self._train(config.episodes_per_iteration * config.updates_per_episode, budget)
        pretraining = config.collect_steps + config.pretrain_steps
        may_move = store.num_added * config.episode_steps > pretraining
        events, scalars = self._move(real, may_move)
        estimate = unsure(self.distribution, "weak")
        if not self.num_moves:
            estimate = unsure(self.distribution, "not identifiable")
            estimate = replace(estimate, warnings=[_NOT_MOVED])
        return Round(estimate, events, {"spm_loss": loss, **scalars})

    def _collect(self, real: list[Trajectory]) -> None:
        """Add one iteration's episodes to D_sp, each in a world of its own drawn from Ξ."""
        num, steps = self.config.episodes_per_iteration, self.config.episode_steps
        chosen = self._rng.integers(len(real), size=num)
        actions = np.stack([real[i].actions[np.arange(steps) % len(real[i])] for i in chosen])
        parameters = self.distribution.sample(num, self._rng)
        rollouts = self._simulator.roll_out(
            parameters, actions, self._rng, self._observation.observe_beside()
        )
        if not len(rollouts):
            raise RuntimeError("every simulated world diverged; check the timestep and the bounds")
        scale, frames = self._simulator.action_scale, self._simulator.film(rollouts)
        measured = self._observation.readings(rollouts.observed, self._rng)
        readings = np.concatenate([rollouts.observed[..., :0], *measured.values()], -1)
        if not self._store.num_added:
            self.model.scale_readings(readings)
        self._store.add(Episodes.unrewarded(rollouts, scale, frames, readings))

    def _train(self, num_updates: int, budget: Budget) -> float:
        """At least one update of q_φ; returns their mean loss."""
        config, losses = self.config, []
        seed = int(self._rng.integers(2**62))  # of dropout, so that resuming repeats it
        with seeded(seed, self._device):
            for _ in range(num_updates):
                windows, truth = self._buffer.sample(
                    config.batch_size, config.window, config.crop_size, self._rng
                )
                if self.method == "regression":
                    loss = self.model.regression_loss(windows, truth)
                else:
                    # U[0, 2·ξ_mean] (Sec. V), independent parameters, clipped to their bounds
                    reach = self.distribution.around(self.distribution.mean, 1.0)
                    candidates = reach.sample(config.num_candidates, self._rng)
                    loss = self.model.loss(windows, truth, candidates)
                self._optimizer.zero_grad(set_to_none=True)
                loss.backward()
                self._optimizer.step()
                losses.append(loss.detach())
                if budget.is_over:
                    break
        return float(torch.stack(losses).mean())

    def _move(self, real: list[Trajectory], may_move: bool) -> tuple[list[Event], dict[str, float]]:
        """Move ξ_mean by one step; returns arrivals at bounds, and the network's answer."""
        mean, step_size = self.distribution.mean, self.config.step_size
        if self.method == "regression":
            answer, key = self.model.predict(real), "predicted"
            moved = approach(mean, answer, step_size, self.space)
        else:
            answer, key = self.model.prob_higher(real, mean), "prob_higher"
            moved = shift_mean(mean, answer, step_size, self.space, self.distribution.start)
        events = []
        if may_move:
            self.num_moves += 1
            self.distribution = self.distribution.around(moved, self.config.range_spm)
            events = arrivals(mean, self.distribution)
        return events, {f"{key}/{n}": v for n, v in self.space.to_dict(answer).items()}

    def check(self, real: list[Trajectory], names: Sequence[str] = ()) -> None:
        """Raises InputError for pictures of another size, and for too short trajectories."""
        size, window = self._simulator.image_size, self.config.window
        for index, trajectory in enumerate(real):
            episode = episode_in_words(names, index)
            height, width = trajectory.frames.shape[1:3]
            if (height, width) != (size, size):
                raise InputError(
                    f"{episode} has pictures of {width}×{height}; expected {size}×{size}: crop "
                    "the recordings to a square"
                )
            if len(trajectory) < window:
                raise InputError(
                    f"{episode} has {len(trajectory)} steps; search={self.method!r} needs at least "
                    f"{window}: leave it out (--leave-out), or record a longer one"
                )

    def tensors(self) -> dict[str, torch.Tensor]:
        """Weights, optimizer moments, and D_sp without its frames, which are drawn anew."""
        model = {f"model.{k}": v for k, v in self.model.state_dict().items()}
        optimizer = {f"optimizer.{k}": v for k, v in optimizer_tensors(self._optimizer).items()}
        return model | optimizer | {f"store.{k}": v for k, v in self._store.tensors().items()}

    def state(self) -> dict[str, Any]:
        return {
            "mean": self.distribution.mean.tolist(),
            "num_moves": self.num_moves,
            "store": self._store.state(),
            "rng": self._rng.bit_generator.state,
        }

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        load_weights(self.model, under("model.", tensors), "model")
        load_optimizer_tensors(self._optimizer, under("optimizer.", tensors))
        self._store.load(under("store.", tensors), state["store"], self._simulator.render)
        mean, range_ = np.array(state["mean"]), self.config.range_spm
        self.distribution = self.distribution.around(mean, range_)
        self.num_moves = state["num_moves"]
        self._rng.bit_generator.state = state["rng"]
