"""Pictures of what measured joints move, drawn where readings have them."""

import copy
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import mujoco
import numpy as np

from simtune.checking.film.camera_film import MOST_FILMED_STEPS
from simtune.checking.film.library import squares
from simtune.fit import Readings
from simtune.fit.physics import Physics
from simtune.fit.readings.measured_states import MeasuredStates
from simtune.observation import ObservationModel, measured_places
from simtune.parameters.backlash_joints import play_of
from simtune.parameters.joint_types import HINGE
from simtune.simulation import PictureSettings, Simulator
from simtune.simulation.rendering.appearance import NUM_GROUPS
from simtune.simulation.rendering.plate import stands_still
from simtune.simulation.rendering.renderers import Renderers
from simtune.trajectory import Trajectory, moments
from simtune.vision.keypoints import is_drawn


class AsRead:
    """Episodes whose joints are put where readings have them.

    What other joints carry is not drawn: nothing is known of a hand's place if the arm is not
    measured.
    """

    def __init__(
        self, simulator: Simulator, observation: ObservationModel, episodes: Sequence[Trajectory]
    ):
        """`episodes`: with readings."""
        self._simulator, sensors = simulator, observation.sensors
        nominal, rng = simulator.space.nominal, np.random.default_rng(0)
        self._begun = simulator.begin(nominal[None], rng).states[0, 0]
        physics = Physics(simulator, observation.observe_beside(), self._begun)
        measured = MeasuredStates(physics, sensors)
        values = Readings.of(episodes, sensors).values
        states = measured.as_read(values, simulator.space.to_unit(nominal))
        rest = simulator.state_space.positions_and_velocities(self._begun)
        changing = np.flatnonzero((states != rest).any((0, 1))).tolist()  # tied to measured ones
        model, known = simulator.model, {*measured_places(sensors), *changing}
        plays = [play_of(model, j) for j in range(model.njnt) if model.jnt_qposadr[j] in known]
        known |= {int(model.jnt_qposadr[play]) for play in plays if play >= 0}
        is_placed = _is_placed(model, known)
        moves = is_drawn(model) & is_placed[model.geom_bodyid] & ~stands_still(model)
        self._places: list[int] = model.jnt_qposadr[is_placed[model.jnt_bodyid]].tolist()
        self._places *= bool(moves.any())
        self._renderers = _renderers(simulator, is_placed) if self._places else None
        self._states = np.tile(rest, (*states.shape[:2], 1))
        self._states[..., self._places] = states[..., self._places]
        self._lengths = np.array([len(episode) for episode in episodes])

    @property
    def joints(self) -> list[tuple[str, int]]:
        """Names and places of joints that move something; none: nothing can be drawn."""
        model = self._simulator.model
        places = model.jnt_qposadr.tolist()
        return [(model.joint(places.index(place)).name, place) for place in self._places]

    def is_hinge(self, place: int) -> bool:
        """Whether the joint at this place turns."""
        model = self._simulator.model
        return bool(model.jnt_type[model.jnt_qposadr.tolist().index(place)] == HINGE)

    def draw(
        self,
        num_pictures: int,
        late_steps: int = 0,
        changed: Mapping[int, tuple[float, float]] = MappingProxyType({}),
    ) -> list[np.ndarray]:
        """Each view's, (E, K, SIZE, SIZE, 3): moments as `Dataset.skim` keeps them.

        `late_steps`: by which pictures show an earlier moment than readings. `changed`: {place:
        factor on a position, and what is added}.
        """
        last = np.minimum(self._lengths, MOST_FILMED_STEPS)[:, None]
        steps = moments(last, num_pictures) - late_steps
        steps = steps.clip(0, self._lengths[:, None])
        states = self._states[np.arange(len(steps))[:, None], steps]
        for place, (factor, added) in changed.items():
            states[..., place] = factor * states[..., place] + added
        space, num = self._simulator.state_space, steps.size
        full = space.with_positions_and_velocities(self._begun, states.reshape(num, -1))
        assert self._renderers is not None
        drawn = self._renderers.render(full, np.tile(self._simulator.space.nominal, (num, 1)))
        return squares(drawn, self._simulator.widths, steps.shape)


def _is_placed(model: mujoco.MjModel, known: set[int]) -> np.ndarray:
    """(nbody,) bool: whether only joints at `known` places carry a body."""
    placed = np.ones(model.nbody, bool)
    for body in range(1, model.nbody):  # parents first
        first, num = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        own = model.jnt_qposadr[first : first + num].tolist() if num else []
        placed[body] = placed[model.body_parentid[body]] and known.issuperset(own)
    return placed


def _renderers(simulator: Simulator, is_placed: np.ndarray) -> Renderers:
    """Draws what stands still and bodies that are placed, without what hangs on others."""
    model = copy.copy(simulator.model)
    model.geom_group[~is_placed[model.geom_bodyid]] = NUM_GROUPS
    pictures = PictureSettings(image_size=simulator.image_size, views=tuple(simulator.views))
    return Renderers(model, simulator.space, pictures)
