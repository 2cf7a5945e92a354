"""States of whole episodes as readings give them, of which segments are cut."""

from typing import NamedTuple

import numpy as np

from simtune.fit.readings.segments import Segments, steps_until_next
from simtune.fit.readings.stretches import Readings, Stretches


class ReadStates(NamedTuple):
    """Of E episodes, at each reading."""

    readings: Readings
    states: np.ndarray  # (E, T + 1, nq + nv)
    actuator_states: np.ndarray  # (E, T + 1, S) with what earlier actions left behind
    drift: np.ndarray | None  # (E, T + 1, 2 nv) as in `Stretches`

    def cut(self, segments: Segments, goes_on: bool = False) -> Stretches:
        """Stretches of these segments; shorter ones are padded with NaN and later actions.

        `goes_on`: see `Stretches`. Then segments of no steps, which are not compared with readings,
        are played up to the next one.
        """
        actions, values = self.readings.actions, self.readings.values
        episode, begin, steps = segments
        longest = steps.max()
        if goes_on:
            longest = max(longest, steps_until_next(episode, begin).max())
        rows = np.arange(longest + 1)
        frames = np.minimum(begin[:, None] + rows, values.shape[1] - 1)
        acting = np.minimum(frames[:, :-1], actions.shape[1] - 1)
        is_within = ((rows <= steps[:, None]) & (steps[:, None] > 0))[..., None]
        return Stretches(
            actions[episode[:, None], acting],
            np.where(is_within, values[episode[:, None], frames], np.nan),
            self.states[episode, begin],
            self.actuator_states[episode, begin],
            episode,
            None if self.drift is None else self.drift[episode, begin],
            begin,
            goes_on,
        )
