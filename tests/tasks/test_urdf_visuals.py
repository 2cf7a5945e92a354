"""URDF whose visual meshes MuJoCo cannot read, or would take for those of collisions."""

import logging

import mujoco
import numpy as np
import pytest
from test_object_names import CUBE, INERTIAL, MASS, URDF

from simtune.tasks import load_task

RADIUS_M = 0.11637  # of the visual meshes; those of collisions are twice as large
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/></joint>"""


def link(name: str, visual: str, collision: str) -> str:
    mesh = '<geometry><mesh filename="meshes/{}"/></geometry>'
    return f"""<link name="{name}">{INERTIAL}<visual>{mesh.format(visual)}</visual>
        <collision name="{name}_felt">{mesh.format(collision)}</collision></link>"""


@pytest.fixture
def arm(tmp_path):
    """A URDF's model, and what MuJoCo by itself makes of it; collision meshes are larger."""
    (tmp_path / "tune.toml").write_text(URDF + MASS)
    for file in ("visual/a.obj", "visual/b.obj", "collision/a.obj", "collision/b.obj"):
        path = tmp_path / "meshes" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(CUBE if "visual" in file else CUBE.replace(".1", ".2"))
    (tmp_path / "meshes" / "visual" / "a.dae").write_text("<COLLADA/>")

    def arm(text: str) -> tuple[mujoco.MjModel, mujoco.MjModel]:
        robot = f'<robot name="arm"><link name="base"/>{text}</robot>'
        (tmp_path / "arm.urdf").write_text(robot)
        plain = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.urdf"))
        return load_task(str(tmp_path / "tune.toml")).load_model(), plain

    return arm


def sizes(model: mujoco.MjModel, geoms: np.ndarray) -> list[float]:
    """Radius of some geoms, relative to a visual mesh's."""
    return (model.geom_rbound[geoms] / RADIUS_M).round(2).tolist()


def test_links_of_collada_are_drawn_as_they_collide_and_it_is_said_once(arm, caplog):
    """Also where a fixed joint merges such a link with one that is seen as it is."""
    text = link("forearm", "visual/a.dae", "collision/a.obj")
    text += link("hand", "visual/b.obj", "collision/b.obj")
    text += JOINT.format("elbow", "continuous", "base", "forearm")
    text += JOINT.format("wrist", "fixed", "forearm", "hand")
    with caplog.at_level(logging.WARNING, "simtune"):
        model, plain = arm(text)
        arm(text)
    (said,) = caplog.messages
    assert said.startswith("arm.urdf: MuJoCo reads no a.dae, so links of such meshes are drawn as")
    touching = model.geom_contype > 0
    assert sizes(model, touching) == sizes(plain, np.arange(plain.ngeom)) == [2, 2]
    assert sizes(model, model.geom_group < 3) == [2, 1]
    assert not (touching & (model.geom_group < 3)).any()


def test_meshes_of_one_name_look_and_collide_as_their_own_files_say(arm):
    """MuJoCo knows a mesh by its file's name, without the folder."""
    text = link("forearm", "visual/a.obj", "collision/a.obj")
    text += JOINT.format("elbow", "continuous", "base", "forearm")
    model, plain = arm(text)
    assert sizes(model, model.geom_contype > 0) == sizes(plain, np.arange(1)) == [2]
    assert sizes(model, model.geom_group < 3) == [1]
    shared, _ = arm(text.replace("visual/a.obj", "collision/a.obj"))
    assert shared.nmesh == 1


def test_links_collide_as_their_own_meshes_though_others_have_the_same_name(arm):
    text = link("forearm", "visual/a.obj", "collision/a.obj")
    text += link("hand", "collision/b.obj", "visual/b.obj")
    text += link("thumb", "visual/b.obj", "collision/b.obj")
    for i, (parent, child) in enumerate((("base", "forearm"), ("base", "hand"), ("base", "thumb"))):
        text += JOINT.format(f"joint {i}", "continuous", parent, child)
    model, _ = arm(text)
    assert sizes(model, model.geom_contype > 0) == [2, 1, 2]
    assert sizes(model, model.geom_group < 3) == [1, 2, 1]
