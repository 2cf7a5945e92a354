"""A particle filter of states and parameters together (Gordon, Salmond and Smith 1993).

Many simulated motions follow the observations, and likely ones are resampled. A single picture may
be ambiguous (a left leg or the right one) until the motion decides; until then both hypotheses
survive. Gradient methods, as in `shooting`, never leave the first one.
"""

from dataclasses import dataclass, field

import numpy as np

from simtune.fit.observed import Observed
from simtune.fit.physics import Physics

_LIKELIHOOD_EXPONENT = 0.3  # errors of nearby frames and keypoints are correlated
_FRESH_SHARE = 0.2  # restarted from the first guess, in case all others are lost
_FRESH_PENALTY = 2.0  # subtracted from their log weight
_STATE_JITTER = 0.1  # in units of the first guess's usual errors
_UNIT_JITTER = 0.005  # of parameters in unit coordinates, at each resampling
_MIN_EFFECTIVE_SHARE = 0.5  # effective sample size below which particles are resampled
_LOOK_AHEAD = 12  # steps: a state is an ancestor of the likeliest one this much later


@dataclass(frozen=True)
class Followed:
    """Result of the particle filter for E episodes."""

    states: np.ndarray  # (E, T + 1, nq + nv)
    unit: np.ndarray  # (E, P) means over each episode's second half, in unit coordinates


@dataclass
class _History:
    states: list[np.ndarray] = field(
        default_factory=list
    )  # (E, K, 1, nq + nv) after a step, of the first also before
    parent: list[np.ndarray] = field(default_factory=list)  # (E, K) indices at the previous step
    best: list[np.ndarray] = field(default_factory=list)  # (E,) likeliest after a step
    unit: list[np.ndarray] = field(default_factory=list)  # (E, P) means


class Particles:
    """Follows episodes in worlds of one simulator."""

    def __init__(self, physics: Physics, prior_std: np.ndarray, fitted: np.ndarray, num: int):
        """`num`: per episode; else see `Shooting`."""
        self._physics, self._space, self._num = physics, physics.space, num
        self._prior_std, self._fitted = prior_std, fitted

    def follow(
        self, observed: Observed, states: np.ndarray, unit: np.ndarray, unit_std: np.ndarray
    ) -> Followed:
        """From guesses at (E, T + 1, nq + nv) states and (N,) parameters, with the latter's std."""
        rng, num, history = np.random.default_rng(0), self._num, _History()
        num_episodes, num_steps, _ = observed.actions.shape
        actuator_states = self._physics.replay_actuators(observed.actions, states, unit)
        shape = (num_episodes, num)
        now = self._fresh(states[:, 0], num, rng)  # (E, K, nq + nv)
        drawn = rng.normal(size=(*shape, len(self._fitted)))
        units = np.clip(unit[self._fitted] + unit_std[self._fitted] * drawn, 0, 1)
        weight = np.zeros(shape)  # logarithms
        parent = np.tile(np.arange(num), (num_episodes, 1))
        for t in range(num_steps):
            new, actions = int(t > 0), observed.actions[:, t : t + 1]  # the row that is new
            played, predicted = self._play(now, unit, units, actions, actuator_states[:, t])
            evidence = observed.evidence.at(np.s_[:, None, t + new : t + 2])
            weight = weight + _LIKELIHOOD_EXPONENT * evidence.log_likelihood(predicted[:, :, new:])
            share = np.exp(weight - weight.max(1, keepdims=True))
            share /= share.sum(1, keepdims=True)
            history.states.append(played[:, :, new:])
            history.parent.append(parent)
            history.best.append(weight.argmax(1))
            history.unit.append(np.einsum("ek,ekp->ep", share, units))
            now, units, weight, parent = self._choose(
                played[:, :, -1], units, weight, share, states[:, t + 1], rng
            )
        half = len(history.unit) // 2
        return Followed(self._path(history), np.mean(history.unit[half:], 0))

    def _fresh(self, states: np.ndarray, num: int, rng: np.random.Generator) -> np.ndarray:
        """(E, num, nq + nv) draws around first guesses (E, nq + nv)."""
        around = np.repeat(states[:, None], num, 1)
        errors = rng.normal(size=(*around.shape[:2], self._space.num_tangent))
        return self._space.move(around, errors * self._prior_std)

    def _play(
        self,
        states: np.ndarray,
        unit: np.ndarray,
        units: np.ndarray,
        actions: np.ndarray,
        actuator_states: np.ndarray,
    ):
        """(E, K, 2, nq + nv) states, now and after a step, and predictions."""
        num_episodes, num, size = states.shape
        worlds = np.repeat(unit[None], num_episodes * num, 0)
        worlds[:, self._fitted] = units.reshape(len(worlds), -1)
        full_states, predicted = self._physics.play(
            states.reshape(-1, size),
            worlds,
            np.repeat(actions, num, 0),
            np.repeat(actuator_states, num, 0),
        )
        shape = (num_episodes, num, actions.shape[1] + 1)
        played = np.nan_to_num(self._physics.states(full_states)).reshape(*shape, size)
        return played, predicted.reshape(*shape, -1)

    def _choose(self, states, units, weight, share, guesses, rng: np.random.Generator):
        """Resample, with jitter, where the effective sample size is small."""
        num = weight.shape[1]
        states, units, weight = states.copy(), units.copy(), weight.copy()
        parent = np.tile(np.arange(num), (len(weight), 1))
        num_fresh = int(_FRESH_SHARE * num)
        for episode in np.flatnonzero(1 / np.square(share).sum(1) < _MIN_EFFECTIVE_SHARE * num):
            at = (rng.uniform() + np.arange(num)) / num
            chosen = np.searchsorted(np.cumsum(share[episode]), at).clip(0, num - 1)
            rng.shuffle(chosen)  # the first ones are replaced by fresh particles below
            errors = rng.normal(size=(num, self._space.num_tangent)) * self._prior_std
            states[episode] = self._space.move(states[episode, chosen], _STATE_JITTER * errors)
            states[episode, :num_fresh] = self._fresh(guesses[episode][None], num_fresh, rng)[0]
            drawn = rng.normal(size=units[episode].shape)
            units[episode] = np.clip(units[episode, chosen] + _UNIT_JITTER * drawn, 0, 1)
            weight[episode] = 0
            weight[episode, :num_fresh] = -_FRESH_PENALTY
            parent[episode] = chosen
        return states, units, weight, parent

    def _path(self, history: _History) -> np.ndarray:
        """(E, T + 1, nq + nv): at each step, the ancestor of the best particle later on."""
        episodes, last = np.arange(len(history.best[0])), len(history.best) - 1
        path = []
        for step in range(last + 1):
            later = min(step + _LOOK_AHEAD, last)
            at = history.best[later]
            for t in range(later, step, -1):
                at = history.parent[t][episodes, at]
            path.append(history.states[step][episodes, at])
        return np.concatenate(path, 1)
