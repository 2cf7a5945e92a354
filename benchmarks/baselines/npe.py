"""sbi's neural posterior estimation (NPE) with a CNN embedding, amortised, in a single round.

A simulation is one episode of a world, which replays a real one's actions from a random start;
with sets of episodes the budget would buy too few worlds to learn from. What is filmed are short
stretches of pictures a few steps apart. A CNN looks at each with its actions, and the mean over a
world's stretches is embedded. It learns to estimate all parameters, as one learns summary
statistics; the flow is conditioned on its estimates, and learns from worlds that the CNN was not
taught on. (Taught by the flow's loss alone, the CNN learnt one colour after the other, and was at
the third when the time was over.) At the end it looks at each real episode, and the samples are
pooled. The flow's parameters are coordinates of the range, along each parameter's own scale,
z-scored by sbi; of its flows, its default did best.
"""

import time
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from baselines import Found, Problem
from simtune.networks.layers import predicting, seeded
from simtune.vision.detector import to_input

_STRETCHES = 5  # filmed of an episode
_PICTURES, _EVERY = 5, 2  # of a stretch, and the steps from one to the next
_STEPS = (_PICTURES - 1) * _EVERY
_SIMULATING_SHARE = 0.35  # of the time, at most
_FLOW_SHARE = 0.1  # of the time left then; it needs little
_FLOW_EPOCHS = 300  # at most; it stops when it learns no more
_HELD_OUT = 0.3  # of the worlds, for the flow
_BATCH_SIZE, _LEARNING_RATE = 16, 1e-3
_WORLDS = 32  # simulated at a time
_LOOKS = 4  # at each real episode, at other stretches
_SAMPLES = 500  # of the posterior, for each look
_SAMPLING_S = 120.0  # fail, rather than reject for ever what a leaking flow puts beyond the range


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
    coordinates = torch.tensor(
        problem.first.to_range_unit(simulated.parameters), dtype=torch.float32
    )
    num_taught = round(len(coordinates) * (1 - _HELD_OUT))
    with seeded(problem.seed):
        embedding = _Embedding(simulated, problem.simulator.action_scale)
        left_s = problem.deadline_s - time.monotonic()
        end_s = time.monotonic() + (1 - _FLOW_SHARE) * left_s
        _teach(embedding, simulated, coordinates, np.arange(num_taught), end_s)
        others = np.arange(num_taught, len(coordinates))
        seen, looked_at = _embed(embedding, simulated, others), _embed(embedding, real)
        samples = _sample_posterior(coordinates[num_taught:], seen, looked_at)
    space = problem.first.space
    low, mean, high = problem.first.from_range_unit(np.quantile(samples, [0.05, 0.5, 0.95], axis=0))
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


class _Embedding(nn.Module):
    """Stretches of n episodes to estimates of the parameters (n, N), coordinates of the range."""

    def __init__(self, simulated: _Episodes, action_scale: np.ndarray):
        super().__init__()
        # What differs between worlds is a small part of a picture: pixels are z-scored.
        some = to_input(simulated.pictures[:: len(simulated.pictures) // 64 + 1, 0, 0])
        self._mean, self._std = some.mean(0), some.std(0).mean()
        self._action_scale = torch.tensor(action_scale, dtype=torch.float32)
        layers: list[nn.Module] = []
        for size_in, size_out in ((3 * _PICTURES, 16), (16, 32), (32, 64), (64, 64)):
            layers += [nn.Conv2d(size_in, size_out, 3, 2, 1), nn.BatchNorm2d(size_out), nn.ReLU()]
        self._convolutions = nn.Sequential(*layers, nn.Flatten())
        self._stretch = nn.Sequential(nn.LazyLinear(128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU())
        num_parameters = simulated.parameters.shape[1]
        self._episode = nn.Sequential(
            nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, num_parameters)
        )

    def forward(self, pictures: np.ndarray, actions: np.ndarray) -> torch.Tensor:
        """(n, M, F, H, H, 3) uint8 and (n, M, steps, A)"""
        num, stretches, _, size = pictures.shape[:4]
        scored = (to_input(pictures.reshape(-1, size, size, 3)) - self._mean) / self._std
        stacked = scored.reshape(num * stretches, -1, size, size)
        features = self._convolutions(stacked).unflatten(0, (num, stretches))
        scaled = torch.tensor(actions, dtype=torch.float32) / self._action_scale
        return self._episode(self._stretch(torch.cat([features, scaled.flatten(2)], -1)).mean(1))


def _teach(
    embedding: _Embedding,
    episodes: _Episodes,
    coordinates: torch.Tensor,
    taught: np.ndarray,
    end_s: float,
) -> None:
    """By the mean squared error, until the time is over."""
    embedding(episodes.pictures[:2], episodes.actions[:2])  # finds out its sizes
    optimizer = torch.optim.Adam(embedding.parameters(), _LEARNING_RATE)
    while time.monotonic() < end_s:
        for batch in torch.tensor(taught)[torch.randperm(len(taught))].split(_BATCH_SIZE):
            at = batch.numpy()
            estimated = embedding(episodes.pictures[at], episodes.actions[at])
            loss = nn.functional.mse_loss(estimated, coordinates[batch])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()


def _embed(
    embedding: _Embedding, episodes: _Episodes, which: np.ndarray | None = None
) -> torch.Tensor:
    """(n, N) of those asked for, or of all."""
    which = np.arange(len(episodes.pictures)) if which is None else which
    parts = np.array_split(which, -(-len(which) // _WORLDS))
    with predicting(embedding):
        estimates = [embedding(episodes.pictures[p], episodes.actions[p]) for p in parts]
    return torch.cat(estimates).clone()  # an ordinary tensor, which sbi can learn from


def _sample_posterior(
    coordinates: torch.Tensor, seen: torch.Tensor, looked_at: torch.Tensor
) -> np.ndarray:
    """(n, N) samples given looks at the real episodes, in coordinates of the range."""
    from sbi.inference import NPE
    from sbi.utils import BoxUniform

    num_parameters = coordinates.shape[1]
    prior = BoxUniform(torch.zeros(num_parameters), torch.ones(num_parameters))
    inference = NPE(prior, "maf", show_progress_bars=False, tracker=_Silent())
    inference.append_simulations(coordinates, seen)
    inference.train(training_batch_size=32, max_num_epochs=_FLOW_EPOCHS)
    posterior = inference.build_posterior()
    samples = posterior.sample_batched(
        (_SAMPLES,), x=looked_at, show_progress_bars=False, max_sampling_time=_SAMPLING_S
    )
    return samples.detach().reshape(-1, num_parameters).numpy()


class _Silent:
    """A tracker for sbi that tracks nothing; its own writes into the working folder."""

    log_dir = None

    def __getattr__(self, name: str):
        return lambda *_, **__: None
