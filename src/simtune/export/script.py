"""Python code, without simtune, that writes the result into a user's own copy of the model."""

import inspect
import re
from collections.abc import Iterator
from typing import Any

import mujoco

from simtune.export.mjcf import not_copied
from simtune.export.training.rows import rows_of_object
from simtune.parameters import ModelWriter, field_of, rows_of
from simtune.parameters.fields import DRIVEN
from simtune.parameters.inferred import (
    let_inertias_be_rounded,
    write_down_inferred,
    write_down_springs,
)
from simtune.tasks.tuning_file.name_all import name_all

_SCRIPT = '''"""Write what simtune found into a MuJoCo model.

    python apply.py MODEL.xml TUNED.xml

writes a tuned copy, and overwrites nothing. From Python: apply(model) changes a compiled model, in
which the objects below have the same names as in the one that was tuned.{note}
"""

import os
import sys
from pathlib import Path

import mujoco
import numpy as np

# (field of MjModel, kind of object, its name, the object's values)
FOUND = [
{rows}
]


def apply(model: mujoco.MjModel) -> None:
    for field, kind, name, values in FOUND:
        if kind == "opt":
            setattr(model.opt, field, values)
        else:
            getattr(model, field)[rows_of_object(model, kind, name)] = values
    mujoco.mj_setConst(model, mujoco.MjData(model))


def check(model: mujoco.MjModel) -> None:
    for _, kind, name, _ in FOUND:
        try:
            if kind != "opt":
                rows_of_object(model, kind, name)
        except KeyError as error:
            sys.exit(f"{{sys.argv[1]}} is another model than the tuned one: {{error.args[0]}}")


{functions}


def tuned_spec(path: str) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(path)
{named}    check(spec.copy().compile())
    write_down_inferred(spec)
{prepared}{not_copied}    model = spec.compile()
    apply(model)
    spec.copy_back(model)
    let_inertias_be_rounded(spec)
    spec.compile()  # else MuJoCo would write the inertias that it copied back
    return spec


def in_a_line(error: Exception) -> str:
    return " ".join(str(error).split())


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("expected two files: python apply.py MODEL.xml TUNED.xml")
    original, tuned = sys.argv[1], Path(sys.argv[2])
    if tuned.exists():
        sys.exit(f"{{tuned}} is there already, and nothing is overwritten: give another name")
    new = tuned.with_name(f".{{os.getpid()}}.{{tuned.name}}")  # until it is known to load
    try:
        spec = tuned_spec(original)
    except (ValueError, mujoco.FatalError) as error:
        sys.exit(f"{{original}} would not load: {{in_a_line(error)}}")
    try:
        spec.to_file(str(new))
        mujoco.MjModel.from_xml_path(str(new))
        new.replace(tuned)
    except mujoco.FatalError as error:
        sys.exit(f"cannot write {{tuned}}: {{in_a_line(error)}}")
    except ValueError as error:  # meshes, say, that it names from another folder
        where = f"write it beside {{original}}, or take model.xml"
        sys.exit(f"{{tuned}} would not load: {{in_a_line(error)}}; {{where}}")
    finally:
        new.unlink(missing_ok=True)
'''
_PREPARED = """
Before it is compiled, actuators need what those of model.xml have: a memory of controls (nsample)
where they are late, a filter (dyntype) where they lag, and the limits (forcelimited) found; their
joints and tendons no limit of their own beside it (actuatorfrclimited) if there it is off; bodies
need some gravcomp where weight is compensated, and simple="false" where their centre (ipos, iquat),
or the place or axis of a joint, was found."""

_BY_INDEX = re.compile(
    r"(body|joint|geom|site|camera|light|tendon|actuator|equality|keyframe) \d+"
)  # names that `name_all` gives


def is_nameless(name: str) -> bool:
    """Whether the object has no name of its own, by which to find it in another model."""
    return bool(_BY_INDEX.fullmatch(name))


def apply_script(writer: ModelWriter, model: mujoco.MjModel) -> str:
    """Text of apply.py, with the numbers that `writer` wrote into `model`."""
    rows = [
        f"    ({field!r}, {kind!r}, {name!r}, {values!r}),"
        for field, kind, name, values in _found(writer, model)
    ]
    note = _PREPARED if any(parameter.changes_model for parameter in writer.space) else ""
    prepared = "".join(f"    {line}\n" for line in _preparations(writer, model))
    left_out = "".join(
        f"    spec.{kind}({name!r}).{attribute} = {value!r}\n"
        for kind, name, attribute, value in not_copied(writer, model)
    )
    copied = rows_of_object, write_down_inferred, let_inertias_be_rounded, write_down_springs
    functions = "\n\n".join(map(inspect.getsource, copied))
    named = ""
    if any(is_nameless(name) for _, _, name, _ in _found(writer, model)):
        functions = f"{inspect.getsource(name_all)}\n\n{functions}"
        named = "    name_all(spec)\n"
    rest = {
        "note": note,
        "prepared": prepared,
        "not_copied": left_out,
        "functions": functions,
        "named": named,
    }
    return _SCRIPT.format(rows="\n".join(rows), **rest)


def _preparations(writer: ModelWriter, model: mujoco.MjModel) -> Iterator[str]:
    """Statements that prepare `spec`, except for the memory of controls (`not_copied`)."""
    for parameter in writer.space:
        for name in parameter.objects:
            if parameter.field_info.needs_all_terms:
                owner = {"body": "body({!r})", "jnt": "joint({!r}).parent"}
                yield f"spec.{owner[parameter.field_info.prefix].format(name)}.simple = False"
            elif parameter.is_lag:
                yield f"spec.actuator({name!r}).dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT"
            elif parameter.field_info.form == "range":
                force_range = model.actuator(name).forcerange.tolist()
                yield f"spec.actuator({name!r}).forcelimited = True"
                yield f"spec.actuator({name!r}).forcerange = {force_range!r}"
                yield from _without_limit(model, model.actuator(name))
    if "qpos0" in writer.written:  # which keyframes without a qpos would follow
        yield "for key, qpos in zip(spec.keys, spec.copy().compile().key_qpos):"
        yield "    key.qpos = qpos"
    if any(parameter.is_lag for parameter in writer.space):
        for i, act in enumerate(model.key_act.tolist()):
            yield f"spec.keys[{i}].act = {act!r}"


def _without_limit(model: mujoco.MjModel, actuator: Any) -> Iterator[str]:
    """Lifts the limit of what the actuator drives, if the model has none, which would act too."""
    kind, driven = DRIVEN.get(actuator.trntype[0]), actuator.trnid[0]
    if kind and not getattr(model, f"{kind}_actfrclimited")[driven]:
        owner = {"jnt": "joint", "tendon": "tendon"}[kind]
        name = getattr(model, owner)(driven).name
        yield f"spec.{owner}({name!r}).actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE"


def _found(writer: ModelWriter, model: mujoco.MjModel) -> Iterator[tuple[str, str, str, Any]]:
    """(field, kind of object, name, values) of everything written.

    Values are whole rows, since several parameters may write a row, or numbers be carried along.
    """
    for field, objects in writer.written.items():
        info = field_of(field)
        if info.is_option:
            yield info.attribute, info.prefix, "", info.read(model).tolist()
        for name in objects:
            values = info.read(model)[rows_of(model, field, name)].tolist()
            yield field, info.prefix, name, values if info.prefix == "dof" else values[0]
