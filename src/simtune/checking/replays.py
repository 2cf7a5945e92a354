"""Open-loop replays of recorded episodes at first guesses, as `tune` begins with them."""

from collections.abc import Sequence

from simtune.checking.open_loops import loops_left_open
from simtune.checking.replayed_contacts import Touching, touching
from simtune.checking.sensitivity.parameters import where_analyzed
from simtune.checking.sensitivity.reading_changes import LONGEST_S
from simtune.checking.unsettled_starts import free_bases, unsettled
from simtune.fit import Readings, recorded_loop, where_starts_show
from simtune.observation import ObservationModel
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.readings.warnings import unseen_warning


class RecordedReplays:
    """Of episodes with names, in nominal worlds."""

    def __init__(
        self,
        simulator: Simulator,
        observation: ObservationModel,
        trajectories: Sequence[Trajectory],
        names: Sequence[str],
    ):
        nominal = where_analyzed(simulator.space)
        self._readings = Readings.of(trajectories, observation.sensors)
        loop = recorded_loop(simulator, observation, nominal, self._readings)
        self._unit, self._names = simulator.space.to_unit(nominal), names
        self._loop = where_starts_show(loop, self._readings, self._unit)
        # Readings alone are not replayed if pictures must say where a robot begins
        self._are_used = not (self._loop.unseen and observation.cameras)

    def start_warnings(self) -> list[str]:
        """On bases whose start is unknown, or which do not begin at rest."""
        if not self._are_used:
            return []
        loop = self._loop
        found = [unseen_warning(loop.unseen)] if loop.unseen else []
        found += loops_left_open(loop.physics.simulator.model, loop.sensors, loop.unseen)
        for base in free_bases(loop):
            found += unsettled(loop, base, self._readings, self._unit, self._names)
        return found

    def contacts(self, episodes: Sequence[int]) -> list[Touching]:
        """What touches in these of the episodes; their numbers are those among `episodes`.

        For as long as is looked for errors that grow. Later, replays may be far astray.
        """
        if not len(episodes):
            return []
        steps = round(LONGEST_S / self._loop.physics.simulator.step_s)
        actions, values = self._readings.actions, self._readings.values
        few = Readings(actions[[*episodes], :steps], values[[*episodes], : steps + 1])
        whole = self._loop.cut(few, self._unit)
        return touching(self._loop, whole, whole.states, self._unit)
