"""Python that writes what was found into a user's own copy of the model, without simtune."""

import inspect
from collections.abc import Iterator
from typing import Any

import mujoco

from simtune.export.inferred import write_down_inferred
from simtune.export.mjcf import not_copied
from simtune.parameters import ModelWriter, field_of, rows_of

_SCRIPT = '''"""Write what simtune found into a MuJoCo model.

    python apply.py MODEL.xml TUNED.xml

writes a tuned copy. From Python: apply(model) changes a compiled model, in which the objects below
have the same names as in the one that was tuned.{note}
"""

import sys

import mujoco

# (field of MjModel, kind of object, its name, the object's values)
FOUND = [
{rows}
]


def apply(model: mujoco.MjModel) -> None:
    for field, kind, name, values in FOUND:
        if kind == "opt":
            setattr(model.opt, field, values)
        elif kind == "dof":
            joint = model.joint(name).id
            getattr(model, field)[model.dof_jntid == joint] = values
        else:
            getattr(model, field)[getattr(model, kind)(name).id] = values
    mujoco.mj_setConst(model, mujoco.MjData(model))


{inferred}

if __name__ == "__main__":
    spec = mujoco.MjSpec.from_file(sys.argv[1])
    write_down_inferred(spec)
{not_copied}    model = spec.compile()
    apply(model)
    spec.copy_back(model)
    spec.to_file(sys.argv[2])
'''
_DELAYS = """
Actuators must remember their controls (nsample) for as long as they are to be late, as those of
model.xml do."""


def apply_script(writer: ModelWriter, model: mujoco.MjModel) -> str:
    """The text of apply.py, with the numbers that `writer` wrote into `model`."""
    rows = [
        f"    ({field!r}, {kind!r}, {name!r}, {values!r}),"
        for field, kind, name, values in _found(writer, model)
    ]
    note = _DELAYS if writer.space.is_delay.any() else ""
    left_out = "".join(
        f"    spec.{kind}({name!r}).{attribute} = {value!r}\n"
        for kind, name, attribute, value in not_copied(writer, model)
    )
    inferred = inspect.getsource(write_down_inferred)
    rest = {"note": note, "not_copied": left_out, "inferred": inferred}
    return _SCRIPT.format(rows="\n".join(rows), **rest)


def _found(writer: ModelWriter, model: mujoco.MjModel) -> Iterator[tuple[str, str, str, Any]]:
    """Whole rows, since a field's numbers may be several parameters, or carried along."""
    for field, objects in writer.written.items():
        info = field_of(field)
        if info.is_option:
            yield info.attribute, info.prefix, "", info.read(model).tolist()
        for name in objects:
            values = info.read(model)[rows_of(model, field, name)].tolist()
            yield field, info.prefix, name, values if info.prefix == "dof" else values[0]
