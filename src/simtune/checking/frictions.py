"""Why a friction of contacts does not show: MuJoCo takes that of one geom of the two, or none.

The geom of higher priority counts; of equal ones, the larger friction. A `<pair>` has its own.
Sliding needs contacts of condim 3, spinning 4, and rolling 6 (MuJoCo's documentation, "Contact").
"""

import copy
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from simtune.parameters import Parameter
from simtune.simulation import Simulator

_MOST_STATES = 200  # looked at
_TRIED_FACTOR, _ADDED_FRICTION = 1.2, 1e-3  # of the friction that is tried, which may be 0
_CONDIM = (3, 4, 6)  # that sliding, spinning and rolling friction need
_CONTACT_PLACES = (0, 2, 3)  # in a contact's five frictions


class Contacts(NamedTuple):
    """Of n contacts."""

    geoms: np.ndarray  # (n, 2)
    condim: np.ndarray  # (n,)
    friction: np.ndarray  # (n, 5)
    exclude: np.ndarray  # (n,) why one exerts no force, such as a gap; 0: it does


def unfelt_frictions(simulator: Simulator, states: np.ndarray) -> dict[str, str]:
    """{parameter: why contacts do not feel it} for frictions, in nominal (E, T + 1, S) states."""
    frictions = [p for p in simulator.space.parameters if p.field == "geom_friction"]
    if not frictions or not len(states):
        return {}
    rows = states.reshape(-1, states.shape[-1])
    rows = rows[np.linspace(0, len(rows) - 1, min(_MOST_STATES, len(rows))).astype(int)]
    model = copy.copy(simulator.model)
    found = contacts(model, rows)
    reasons = {p.name: _why_unfelt(model, rows, found, p) for p in frictions}
    return {name: reason for name, reason in reasons.items() if reason}


def contacts(model: mujoco.MjModel, states: np.ndarray) -> Contacts:
    """All contacts of (n, S) states, one state after the other."""
    parts = contacts_of_each(model, states)
    return Contacts(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def contacts_of_each(model: mujoco.MjModel, states: np.ndarray) -> Iterator[Contacts]:
    """Those of each of (n, S) states."""
    data = mujoco.MjData(model)
    for state in states:
        mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_fwdPosition(model, data)
        touching = data.contact
        found = Contacts(touching.geom, touching.dim, touching.friction, touching.exclude)
        yield Contacts(*(values.copy() for values in found))


def _why_unfelt(
    model: mujoco.MjModel, states: np.ndarray, found: Contacts, parameter: Parameter
) -> str | None:
    """None if contacts feel it, or it is not known why not."""
    geoms, column = [model.geom(name).id for name in parameter.objects], parameter.component or 0
    touching = np.isin(found.geoms, geoms).any(1)
    objects = ", ".join(parameter.objects)
    if not touching.any():
        return f"{objects} touches nothing in the states looked at"
    if (condim := found.condim[touching].max()) < (needed := _CONDIM[column]):
        return f'needs contacts of condim="{needed}", and those of {objects} have {condim}'
    nominal = model.geom_friction[geoms, column].copy()
    model.geom_friction[geoms, column] = _TRIED_FACTOR * nominal + _ADDED_FRICTION
    changed = contacts(model, states)
    model.geom_friction[geoms, column] = nominal
    of_contact = _CONTACT_PLACES[column]
    if len(changed.geoms) != len(found.geoms) or np.any(
        changed.friction[touching, of_contact] != found.friction[touching, of_contact]
    ):
        return None
    others = np.setdiff1d(found.geoms[touching], geoms).tolist()
    return _outweighed(model, objects, others)


def _outweighed(model: mujoco.MjModel, objects: str, others: list[int]) -> str:
    """Said if all contacts have the friction of other geoms, or their own."""
    if not others or model.npair:
        return "its contacts have another friction: that of a geom they are with, or of a <pair>"
    names = ", ".join(geom_name(model, other) for other in others)
    return (
        f"its contacts have the friction of {names}: MuJoCo takes the larger one, or that of "
        f'higher priority; give {objects} a priority="1"'
    )


def geom_name(model: mujoco.MjModel, geom: int) -> str:
    """How messages call a geom."""
    if geom < 0:  # MuJoCo's index where a contact is with a flex
        return "a flex"
    return model.geom(geom).name or f"geom {geom}"
