"""The tables [[parameters]] of a tuning file."""

import re
from collections import Counter
from collections.abc import Sequence, Set
from dataclasses import replace

import mujoco

from simtune.errors import InputError, one_line
from simtune.parameters import ModelWriter, Parameter, ParameterSpace, camera_pose, colour, field_of
from simtune.parameters.fields import KINDS
from simtune.simulation import prepare_spec
from simtune.tasks.known_colours import known_colour
from simtune.tasks.tuning_file.field_defaults import (
    check_component,
    check_factor,
    check_field,
    check_gains,
    check_gears,
    check_objects,
    own_nominal,
    own_values,
)
from simtune.tasks.tuning_file.object_names import find_objects
from simtune.tasks.tuning_file.possible_shapes import check_inertia, check_sizes, usual_range
from simtune.tasks.tuning_file.units import usual_unit
from simtune.toml_reading import TomlTable

_NUMBERS = ("nominal", "low", "high", "scale", "unit")
_ALL = ("name", "kind", "field", "objects", "component", *_NUMBERS, "within_m", "within_rad")
_ALL += ("known",)


def read_parameters(
    file: TomlTable, spec: mujoco.MjSpec, cameras: Sequence[str], step_s: float
) -> ParameterSpace:
    """Read all parameters in the file's order and check them against the model.

    `spec` is changed if a parameter needs it. `cameras`: names of the filming cameras; `step_s`:
    duration of a policy step. Raises InputError if a parameter is invalid or does not fit.
    """
    entries = file.tables("parameters")
    if not entries:
        raise file.error("nothing to tune: declare parameters, each after a line [[parameters]]")
    model, space = spec.compile(), ParameterSpace([])
    unsure = _of_unsure_inertia(entries, model)
    for entry in entries:
        with entry.at():
            new = _read(entry, model, cameras, unsure)
            space = ParameterSpace([*space, *new], where=file.file.name)
            if any(parameter.changes_model for parameter in new):
                model = _prepared(spec, space, step_s)
            ModelWriter(space, model)  # refuses what cannot be written beside the others
    return space


def _of_unsure_inertia(entries: Sequence[TomlTable], model: mujoco.MjModel) -> set[str]:
    """Bodies of which two inertias or more are searched, or one and the mass, which scales all."""
    counts = Counter[str]()
    for entry in entries:
        if entry.text("field", entry.text("kind", "")) in ("body_mass", "body_inertia", "mass"):
            counts.update(_objects(entry, model, "body_mass", ()))
    return {name for name, count in counts.items() if count > 1}


def _prepared(spec: mujoco.MjSpec, space: ParameterSpace, step_s: float) -> mujoco.MjModel:
    prepare_spec(spec, space, step_s)
    try:
        return spec.compile()
    except ValueError as error:
        name = space.parameters[-1].name
        raise InputError(f"MuJoCo allows no {name} there: {one_line(error)}") from None


def parameter_name(entry: TomlTable) -> str:
    """A parameter's name, which options and tables list with others. Raises InputError."""
    name = entry.text("name")
    if not re.fullmatch(r"[A-Za-z0-9_\-]+", name):
        raise entry.error(f"name must be letters, digits, _ and - only, got {name!r}", "name")
    return name


def read_known_colours(file: TomlTable, space: ParameterSpace) -> dict[str, float]:
    """{parameter: value} of the colours with `known = true`. Raises InputError."""
    known: dict[str, float] = {}
    for entry in file.tables("parameters"):
        if entry.flag("known", False):
            with entry.at("known"):
                known |= known_colour(space, entry.text("name"), None)
    if len(known) == len(space):
        raise file.error("nothing to tune: all parameters are known", "parameters")
    return known


def _read(
    entry: TomlTable, model: mujoco.MjModel, cameras: Sequence[str], unsure: Set[str]
) -> list[Parameter]:
    """`unsure`: bodies of `_of_unsure_inertia`."""
    name = parameter_name(entry)
    if "field" in entry and "kind" in entry:
        raise entry.error(f"{name} has both kind and field: expected one of them", "field")
    if "field" in entry:
        entry.allow("name", "field", "objects", "component", *_NUMBERS)
        field = entry.text("field")
        component = entry.whole("component", None, least=0)
        objects = _objects(entry, model, field, ())
        return [_number(entry, model, field, objects, component, unsure)]
    if "kind" not in entry:
        entry.allow(*_ALL)  # first look for a misspelt key
        raise entry.error(f"{name} has neither kind nor field: expected one of them")
    field, kind = KINDS[entry.choice("kind", KINDS)]
    films = tuple(cameras) if len(cameras) == 1 else None  # with several, the file must name one
    if kind.makes == "rgb":
        return _colour(entry, model, field.name)
    if kind.makes == "pose":
        return _camera_pose(entry, model, films)
    asks = kind.asks_component
    component = entry.whole("component", None, least=0) if asks else kind.component
    entry.allow("name", "kind", "objects", *["component"] * asks, *_NUMBERS)
    films = films if field.prefix == "cam" else None
    objects = _objects(entry, model, field.name, films, plays=kind.form == "play")
    if check := {"gain": check_gains, "gear": check_gears}.get(kind.name):
        with entry.at("objects"):
            check(model, objects)
    apart = kind.name if kind.is_apart else ""
    return [_number(entry, model, field.name, objects, component, unsure, apart)]


def _objects(
    entry: TomlTable,
    model: mujoco.MjModel,
    field: str,
    default: tuple[str, ...] | None = None,
    *,
    plays: bool = False,
) -> tuple[str, ...]:
    """The names meant by the key `objects`, which is required without a default."""
    given = entry.names("objects") if default is None else entry.names("objects", default)
    owner = field_of(field).object_type
    if owner is None or "objects" not in entry:
        return given
    with entry.at("objects"):
        return find_objects(model, owner.name, given, plays=plays)


def _number(
    entry: TomlTable,
    model: mujoco.MjModel,
    field: str,
    objects: tuple[str, ...],
    component: int | None,
    unsure: Set[str],
    kind: str = "",
) -> Parameter:
    """One parameter; missing keys default to the model's value or the field's usual range."""
    draft = _draft(entry, model, field, objects, component, kind)
    name, nominal = draft.name, entry.number("nominal", None)
    if nominal is None:
        nominal = own_nominal(model, draft)
    if "objects" in entry:
        with entry.at("objects"):
            check_factor(model, draft, [o for o in entry.names("objects") if o in objects])
    if nominal < 0 and draft.field_info.is_never_negative:
        raise entry.error(f"{name}: {field} cannot be negative, got {nominal:g}", "nominal")
    low, high, scale = usual_range(model, draft, nominal, unsure)
    low, high = entry.number("low", low), entry.number("high", high)
    if low is None or high is None:
        known = " and ".join(k for k, v in (("low", low), ("high", high)) if v is None)
        wanted = f"{field} has no usual range around {nominal:g}: give {known}"
        if nominal == 0 and not draft.is_delay and "nominal" not in entry:
            wanted = f"{field} is 0 in the model, so there is no usual range: give nominal, a guess"
        raise entry.error(f"{name}: {wanted}")
    scale = entry.choice("scale", ("log", "linear"), scale if low > 0 else "linear")
    unit = entry.text("unit", usual_unit(model, draft))
    with entry.at("low" if "low" in entry else "nominal"):
        check_inertia(model, draft, unsure, nominal, low, high)
        return replace(draft, nominal=nominal, low=low, high=high, scale=scale, unit=unit)


def _draft(
    entry: TomlTable,
    model: mujoco.MjModel,
    field: str,
    objects: tuple[str, ...],
    component: int | None = None,
    kind: str = "",
) -> Parameter:
    """The parameter with placeholders for nominal and bounds, checked against the model."""
    if twice := next((name for name in objects if objects.count(name) > 1), None):
        raise entry.error(f"{twice!r} is named twice", "objects")
    with entry.at("field"):
        check_field(model, field)
    draft = Parameter(
        name=entry.text("name"),
        field=field,
        objects=objects,
        component=component,
        nominal=0.0,
        low=0.0,
        high=1.0,
        scale="linear",
        unit="1",
        kind=kind,
    )
    with entry.at("component" if component is not None else "objects"):
        check_component(model, draft)
        check_sizes(model, draft)
    with entry.at("objects"):
        own_values(model, draft)  # refuses what cannot be written
        check_objects(model, draft)
    return draft


def _colour(entry: TomlTable, model: mujoco.MjModel, field: str) -> list[Parameter]:
    """Parameters NAME_r, NAME_g and NAME_b."""
    entry.allow("name", "kind", "objects", "nominal", "known")
    objects = _objects(entry, model, field)
    channels = [_draft(entry, model, field, objects, i) for i in range(3)]
    given = entry.numbers("nominal", 3, None)
    red, green, blue = given or (own_nominal(model, channel) for channel in channels)
    return colour(entry.text("name"), objects, (red, green, blue), field=field)


def _camera_pose(
    entry: TomlTable, model: mujoco.MjModel, films: tuple[str, ...] | None
) -> list[Parameter]:
    """Parameters NAME_x, NAME_y, NAME_z, NAME_pitch, NAME_yaw and NAME_roll."""
    entry.allow("name", "kind", "objects", "within_m", "within_rad")
    cameras = _objects(entry, model, "cam_pos", films)
    if len(cameras) != 1:
        raise entry.error("a camera_pose is of one camera", "objects")
    _draft(entry, model, "cam_quat", cameras, 0)
    position = own_values(model, _draft(entry, model, "cam_pos", cameras))[0]
    x, y, z = map(float, position)
    keys = [key for key in ("within_m", "within_rad") if key in entry]
    within = {key: entry.number(key, above=0) for key in keys}
    return camera_pose(entry.text("name"), cameras[0], (x, y, z), **within)
