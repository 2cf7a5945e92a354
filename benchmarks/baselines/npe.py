"""sbi's neural posterior estimation (NPE) with a CNN embedding, amortised, in a single round.

A simulation is one episode of a world, which replays a real one's actions from a random start;
with sets of episodes the budget would buy too few worlds to learn from. What is filmed are short
stretches of pictures a few steps apart; a CNN embeds each with its actions, and the flow is
conditioned on the mean over a world's stretches. At the end it looks at each real episode, and
the samples are pooled. The flow's parameters are coordinates of the range, along each parameter's
own scale, unconstrained by sbi, so that it cannot leak beyond the range.
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

_STRETCHES = 5  # filmed of an episode
_PICTURES, _EVERY = 5, 2  # of a stretch, and the steps from one to the next
_STEPS = (_PICTURES - 1) * _EVERY
_SIMULATING_SHARE = 0.35  # of the time, at most
_WORLDS = 32  # simulated at a time
_LOOKS = 4  # at each real episode, at other stretches
_SAMPLES = 500  # of the posterior, for each look


@dataclass(frozen=True)
class _Episodes:
    """n episodes, of which M stretches are seen."""

    parameters: np.ndarray  # (n, N)
    pictures: np.ndarray  # (n, M, F, H, H, 3) uint8
    actions: np.ndarray  # (n, M, steps, A)


def find(problem: Problem) -> Found:
    rng = np.random.default_rng(problem.seed)
    simulated = _simulate_all(problem, rng)
    real = _look(problem, rng)
    with seeded(problem.seed):
        samples = _sample_posterior(problem, simulated, real)
    space = problem.first.space
    low, mean, high = problem.first.from_local(np.quantile(samples, [0.05, 0.5, 0.95], axis=0))
    return Found(space.to_dict(mean), space.to_dict(low), space.to_dict(high))


def _simulate_all(problem: Problem, rng: np.random.Generator) -> _Episodes:
    """As many worlds as the budget pays for, or the time allows."""
    began_s = time.monotonic()
    end_s = began_s + _SIMULATING_SHARE * (problem.deadline_s - began_s)
    chunks = [_simulate(problem, rng)]
    chunk_steps = problem.simulator.num_steps
    while problem.simulator.num_steps + chunk_steps <= problem.budget_steps:
        chunks.append(_simulate(problem, rng))
        if time.monotonic() > end_s:
            break
    columns = zip(*(vars(chunk).values() for chunk in chunks), strict=True)
    return _Episodes(*(np.concatenate(column) for column in columns))


def _simulate(problem: Problem, rng: np.random.Generator) -> _Episodes:
    """Worlds from the range; those that diverge are left out."""
    steps = min(map(len, problem.real))
    actions = np.stack([t.actions[:steps] for t in problem.real]).astype(float)
    rollouts = problem.simulator.roll_out(
        problem.first.sample(_WORLDS, rng), actions[rng.integers(len(actions), size=_WORLDS)], rng
    )
    num = len(rollouts)
    seen, played = _stretches(rng.integers(0, steps - _STEPS + 1, (num, _STRETCHES)))
    world = np.arange(num)[:, None, None]
    states = rollouts.states[world, seen]  # (n, M, F, S)
    each = np.repeat(rollouts.parameters, _STRETCHES * _PICTURES, axis=0)
    pictures = problem.simulator.render(states.reshape(len(each), states.shape[-1]), each)
    pictures = pictures.reshape(*states.shape[:3], *pictures.shape[1:])
    return _Episodes(rollouts.parameters, pictures, rollouts.actions[world, played])


def _stretches(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The steps of which pictures are taken, and the actions between, from (..., M) first steps."""
    return at[..., None] + np.arange(_PICTURES) * _EVERY, at[..., None] + np.arange(_STEPS)


def _look(problem: Problem, rng: np.random.Generator) -> _Episodes:
    """The real episodes, some times over, as the simulated ones are seen."""
    pictures, actions = [], []
    for trajectory in _LOOKS * problem.real:
        steps = len(trajectory)
        seen, played = _stretches(rng.integers(0, steps - _STEPS + 1, _STRETCHES))
        pictures.append(trajectory.frames[seen])
        actions.append(trajectory.actions[played])
    unknown = np.empty((len(pictures), 0))
    return _Episodes(unknown, np.stack(pictures), np.stack(actions))


def _sample_posterior(problem: Problem, simulated: _Episodes, real: _Episodes) -> np.ndarray:
    """(n, N) samples given the real episodes, in coordinates of the range."""
    from sbi.inference import NPE
    from sbi.neural_nets import posterior_nn
    from sbi.utils import BoxUniform

    num, num_parameters = simulated.parameters.shape
    embedding = _Embedding(simulated, real, problem.simulator.action_scale)
    prior = BoxUniform(torch.zeros(num_parameters), torch.ones(num_parameters))
    flow = posterior_nn(
        "zuko_maf",
        z_score_theta="transform_to_unconstrained",
        x_dist=prior,
        z_score_x="none",
        embedding_net=embedding,
    )
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
    looks = torch.arange(num, num + len(real.pictures), dtype=torch.float32)[:, None]
    samples = posterior.sample_batched((_SAMPLES,), x=looks, show_progress_bars=False)
    return samples.detach().reshape(-1, num_parameters).numpy()


class _Embedding(nn.Module):
    """Rows of episodes (B, 1) to features (B, 64).

    sbi keeps what it learns from as float32, four times as large as pictures are. So it is
    given rows, which are looked up here.
    """

    def __init__(self, simulated: _Episodes, real: _Episodes, action_scale: np.ndarray):
        super().__init__()
        self._pictures = np.concatenate([simulated.pictures, real.pictures])
        # What differs between worlds is a small part of a picture: pixels are z-scored, too.
        some = to_input(simulated.pictures[:: len(simulated.pictures) // 64 + 1, 0, 0])
        self._mean, self._std = some.mean(0), some.std(0).mean()
        actions = np.concatenate([simulated.actions, real.actions]) / action_scale
        self._actions = torch.tensor(actions, dtype=torch.float32).flatten(2)
        layers: list[nn.Module] = []
        for size_in, size_out in ((3 * _PICTURES, 16), (16, 32), (32, 64), (64, 64)):
            layers += [nn.Conv2d(size_in, size_out, 3, 2, 1), nn.BatchNorm2d(size_out), nn.ReLU()]
        self._convolutions = nn.Sequential(*layers, nn.Flatten())
        self._stretch = nn.Sequential(nn.LazyLinear(128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU())
        self._episode = nn.Sequential(nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, 64))
        self(torch.zeros(1, 1))  # finds out sizes

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        at = rows[:, 0].long()
        pictures = self._pictures[at.numpy()]  # (B, M, F, H, H, 3)
        batch, stretches, _, size = pictures.shape[:4]
        scored = (to_input(pictures.reshape(-1, size, size, 3)) - self._mean) / self._std
        stacked = scored.reshape(batch * stretches, -1, size, size)
        features = self._convolutions(stacked).unflatten(0, (batch, stretches))
        features = self._stretch(torch.cat([features, self._actions[at]], -1))
        return self._episode(features.mean(1))


class _Silent:
    """A tracker for sbi that tracks nothing; its own writes into the working folder."""

    log_dir = None

    def __getattr__(self, name: str):
        return lambda *_, **__: None
