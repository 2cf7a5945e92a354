"""URDF: links are drawn by their visual geometry, and its packages' files are found."""

import re
from pathlib import Path

import mujoco

from simtune.tasks.tuning_file.named_files import in_package
from simtune.tasks.tuning_file.urdf_visuals import draw_all_links, tell_meshes_apart

_HIDDEN = 3  # a group that no renderer draws
_KEEP_VISUALS = '<mujoco><compiler discardvisual="false"/></mujoco>'


def read_urdf(path: Path) -> mujoco.MjSpec:
    """A URDF whose links are drawn as a camera sees them.

    By default MuJoCo drops visual geometry, and draws what is meant for collisions. Here that is
    hidden, in links that have both. A file with a <mujoco> of its own is read as it says. Raises
    ValueError if MuJoCo cannot read it.
    """
    # Comments may name the same tags; lines keep their numbers
    text = re.sub(
        r"<!--.*?-->",
        lambda comment: "\n" * comment[0].count("\n"),
        path.read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    if "<mujoco" in text:
        return mujoco.MjSpec.from_file(str(path))
    text, files = tell_meshes_apart(draw_all_links(text, path.name))
    spec = mujoco.MjSpec.from_string(
        re.sub(r"(<robot\b[^>]*>)", rf"\1{_KEEP_VISUALS}", text, count=1)
    )
    spec.modelfiledir = str(path.parent)
    for mesh in spec.meshes:
        mesh.file = files.get(mesh.file, mesh.file)
    for body in spec.bodies:
        geoms = list(body.geoms)
        seen = [geom for geom in geoms if not geom.contype and not geom.conaffinity]
        for geom in geoms:
            if seen and geom not in seen:
                geom.group = _HIDDEN
    return spec


def find_packages(spec: mujoco.MjSpec, model: Path) -> None:
    """Resolve "package://NAME/FILE" to files near the model."""
    for mesh in spec.meshes:
        if found := in_package(mesh.file, model.resolve()):
            mesh.file = str(found)
