"""sbi's neural posterior estimation (NPE) with a CNN embedding, amortised, in a single round.

A simulation is a world that replays the real actions, one episode for each real one, from random
starts. What is filmed of it are short stretches of pictures a few steps apart; a CNN embeds each
stretch with its actions, and the mean over all stretches is what the flow is conditioned on: a
set of videos is one question here too. The flow's parameters are coordinates of the range, along
each parameter's own scale, z-scored by sbi.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn

from baselines import Found, Problem
from simtune.networks import seeded
from simtune.search_param_model.sight import to_input
from simtune.search_param_model.simulated import whole_sets

_STRETCHES = 3  # filmed of each episode
_PICTURES, _EVERY = 5, 2  # of a stretch, and the steps from one to the next
_STEPS = (_PICTURES - 1) * _EVERY
_SIMULATING_SHARE = 0.35  # of the time, at most
_PILOTS = 8  # worlds to learn how long one takes
_LEARNT_FROM = 5  # of a set's stretches, others at each update: many small updates, not few large
_LOOKS = 16  # at the real episodes, each at other stretches; their samples are pooled
_SAMPLES = 500  # of the posterior, for each look


@dataclass(frozen=True)
class _Sets:
    """n sets of M stretches."""

    parameters: np.ndarray  # (n, N)
    pictures: np.ndarray  # (n, M, F, H, H, 3) uint8
    actions: np.ndarray  # (n, M, steps, A)


def find(problem: Problem) -> Found:
    rng = np.random.default_rng(problem.seed)
    simulated = _simulate_all(problem, rng)
    real = _looks(problem, rng)
    with seeded(problem.seed):
        samples = _sample_posterior(problem, simulated, real)
    space = problem.first.space
    low, mean, high = problem.first.from_local(np.quantile(samples, [0.05, 0.5, 0.95], axis=0))
    return Found(space.to_dict(mean), space.to_dict(low), space.to_dict(high))


def _simulate_all(problem: Problem, rng: np.random.Generator) -> _Sets:
    """As many worlds as the budget pays for, or the time allows."""
    began_s = time.monotonic()
    steps_a_world = sum(map(len, problem.real))
    chunks = [_simulate(problem, _PILOTS, rng)]  # compiles
    began_s, allowed_s = time.monotonic(), problem.deadline_s - began_s
    while problem.simulator.num_steps + _PILOTS * steps_a_world <= problem.budget_steps:
        chunks.append(_simulate(problem, _PILOTS, rng))
        if time.monotonic() - began_s > _SIMULATING_SHARE * allowed_s:
            break
    columns = zip(*(vars(chunk).values() for chunk in chunks), strict=True)
    return _Sets(*(np.concatenate(column) for column in columns))


def _simulate(problem: Problem, num_worlds: int, rng: np.random.Generator) -> _Sets:
    """Worlds from the range; those of which an episode diverged are left out."""
    steps, episodes = min(map(len, problem.real)), len(problem.real)
    parameters = problem.first.sample(num_worlds, rng)
    actions = np.stack([t.actions[:steps] for t in problem.real]).astype(float)
    rollouts = problem.simulator.roll_out(
        np.repeat(parameters, episodes, axis=0), np.tile(actions, (num_worlds, 1, 1)), rng
    )
    worlds = whole_sets(rollouts.parameters, episodes)  # (W, E)
    at = rng.integers(0, steps - _STEPS + 1, (worlds.size, _STRETCHES))
    seen, played = _stretches(at)
    episode = worlds.reshape(-1, 1, 1)
    states = rollouts.states[episode, seen]  # (W·E, V, F, S)
    kept = rollouts.parameters[worlds[:, 0]]
    each = np.repeat(kept, episodes * _STRETCHES * _PICTURES, axis=0)
    pictures = problem.simulator.render(states.reshape(len(each), states.shape[-1]), each)
    return _Sets(
        kept,
        pictures.reshape(len(kept), episodes * _STRETCHES, _PICTURES, *pictures.shape[1:]),
        rollouts.actions[episode, played].reshape(
            len(kept), episodes * _STRETCHES, _STEPS, actions.shape[-1]
        ),
    )


def _stretches(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The steps of which pictures are taken, and the actions between, from (E, V) first steps."""
    return at[..., None] + np.arange(_PICTURES) * _EVERY, at[..., None] + np.arange(_STEPS)


def _looks(problem: Problem, rng: np.random.Generator) -> _Sets:
    """The real episodes, some times over: sets as those of a simulated world."""
    steps = min(map(len, problem.real))
    pictures, actions = [], []
    for _ in range(_LOOKS):
        for trajectory in problem.real:
            seen, played = _stretches(rng.integers(0, steps - _STEPS + 1, _STRETCHES))
            pictures.append(trajectory.frames[seen])
            actions.append(trajectory.actions[played])
    sets = (_LOOKS, len(problem.real) * _STRETCHES)
    none = np.empty((_LOOKS, 0))
    pictures, actions = np.stack(pictures), np.stack(actions)
    return _Sets(
        none,
        pictures.reshape(*sets, *pictures.shape[2:]),
        actions.reshape(*sets, *actions.shape[2:]),
    )


def _sample_posterior(problem: Problem, simulated: _Sets, real: _Sets) -> np.ndarray:
    """(n, N) samples given the real episodes, in coordinates of the range."""
    from sbi.inference import NPE
    from sbi.neural_nets import posterior_nn
    from sbi.utils import BoxUniform

    num, num_parameters = simulated.parameters.shape
    embedding = _Embedding(simulated, real, problem.simulator.action_scale)
    flow = posterior_nn("maf", embedding_net=embedding, z_score_x="none")
    prior = BoxUniform(torch.zeros(num_parameters), torch.ones(num_parameters))
    inference = NPE(prior, flow, show_progress_bars=False, tracker=_Silent())
    rows = torch.arange(num, dtype=torch.float32)[:, None]
    coordinates = problem.first.to_local(simulated.parameters)
    inference.append_simulations(torch.tensor(coordinates, dtype=torch.float32), rows)
    settings: dict[str, Any] = {"training_batch_size": 16, "learning_rate": 1e-3}
    began_s = time.monotonic()
    inference.train(max_num_epochs=1, **settings)  # two epochs, says its loop
    left = (problem.deadline_s - time.monotonic()) / ((time.monotonic() - began_s) / 2)
    epochs = 1 + max(1, int(0.9 * left))
    inference.train(max_num_epochs=epochs, resume_training=True, **settings)
    posterior = inference.build_posterior()
    looks = torch.arange(num, num + _LOOKS, dtype=torch.float32)[:, None]
    # Without rejecting what lies beyond the range, which may take forever where a flow leaks.
    samples = posterior.sample_batched(
        (_SAMPLES,), x=looks, show_progress_bars=False, reject_outside_prior=False
    )
    return samples.detach().reshape(-1, num_parameters).clamp(0, 1).numpy()


class _Embedding(nn.Module):
    """Rows of sets (B, 1) to features (B, 64).

    sbi keeps what it learns from as float32, four times as large as pictures are. So it is
    given rows, which are looked up here.
    """

    def __init__(self, simulated: _Sets, real: _Sets, action_scale: np.ndarray):
        super().__init__()
        self._pictures = np.concatenate([simulated.pictures, real.pictures])
        actions = np.concatenate([simulated.actions, real.actions]) / action_scale
        self._actions = torch.tensor(actions, dtype=torch.float32).flatten(2)
        layers: list[nn.Module] = []
        for size_in, size_out in ((3 * _PICTURES, 16), (16, 32), (32, 64), (64, 64)):
            layers += [nn.Conv2d(size_in, size_out, 3, 2, 1), nn.ReLU()]
        self._convolutions = nn.Sequential(*layers, nn.Flatten())
        self._stretch = nn.Sequential(nn.LazyLinear(128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU())
        self._set = nn.Sequential(nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, 64))
        self(torch.zeros(1, 1))  # finds out sizes

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        which = torch.arange(self._actions.shape[1])
        if self.training:
            which = torch.randperm(len(which))[:_LEARNT_FROM]
        at = rows.long()  # (B, 1)
        pictures = self._pictures[at.numpy(), which.numpy()]  # (B, M, F, H, H, 3)
        batch, stretches, _, size = pictures.shape[:4]
        stacked = to_input(pictures.reshape(-1, size, size, 3))
        stacked = stacked.reshape(batch * stretches, -1, size, size)
        features = self._convolutions(stacked).unflatten(0, (batch, stretches))
        features = self._stretch(torch.cat([features, self._actions[at, which]], -1))
        return self._set(features.mean(1))


class _Silent:
    """A tracker for sbi that tracks nothing; its own writes into the working folder."""

    log_dir = None

    def __getattr__(self, name: str):
        return lambda *_, **__: None
