"""OpenGL's rules of light, textures and clipping, in the ray caster: as MuJoCo draws them."""

from io import BytesIO

import mujoco
import numpy as np
import pytest
from matplotlib.image import imsave
from test_renderers import initial_state, opengl_or_skip

from simtune.cameras.views import View
from simtune.parameters import Parameter, ParameterSpace
from simtune.simulation import OpenGLQuality, PictureSettings
from simtune.simulation.rendering.raycaster import Raycaster

SIZE = 64
NO_SHADOWS, SHADOWS = OpenGLQuality(), OpenGLQuality(shadow_map_px=512)
SCENE = """
<mujoco>
  <statistic extent="{extent}" center="0 0 0"/>
  <visual><headlight {headlight}/></visual>
  <asset>
    <texture name="t" type="2d" builtin="checker" rgb1=".8 .4 .1" rgb2=".4 .4 .3" width="64"
             height="64" {texture}/>
    <texture type="skybox" builtin="gradient" rgb1=".6 .6 .8" rgb2=".2 .3 .4" width="64"
             height="384" {texture}/>
    <material name="m" texture="t" texrepeat="1 1" {material}/>
    <material name="plain" rgba=".6 .5 .4 1" {material}/>
    <material name="red" rgba=".9 .1 .1 1" specular="0"/>
    <mesh name="cube" vertex="-.2 -.2 -.2  .2 -.2 -.2  -.2 .2 -.2  .2 .2 -.2
                              -.2 -.2 .2  .2 -.2 .2  -.2 .2 .2  .2 .2 .2"/>
  </asset>
  <worldbody>
    {lamps}
    <camera name="c" pos="0 -2.5 1.5" xyaxes="1 0 0 0 .5 .85" fovy="50"/>
    {things}
  </worldbody>
</mujoco>
"""
DARK, BRIGHT = 'active="0"', 'ambient=".3 .3 .3" diffuse=".6 .6 .6" specular="0 0 0"'
DIM = 'diffuse=".08 .08 .08" specular="0 0 0" castshadow="false"'
ONLY_GLOSS = 'diffuse="0 0 0" specular="1 1 1"'
CHECKS, FLOOR = (f'<geom type="plane" size="2 2 .1" material="{name}"/>' for name in ("m", "plain"))
FINE_FLOOR = FLOOR.replace("2 2 .1", "2 2 .02")  # lit at more points, as OpenGL does
RAMP = np.linspace(0, 255, 64)
PIXELS = np.stack([*np.meshgrid(RAMP, RAMP), np.full((64, 64), 128)], -1).astype(np.uint8)
GREY = '<texture name="grey" type="2d" file="image.png" nchannel="1"/>'
GREY += '<material name="grey" texture="grey" rgba=".3 .6 .4 1" specular="0"/>'
BALL = '<geom size=".5" pos="0 0 .5" material="plain"/>'
CUBE = '<geom type="mesh" mesh="cube" pos="0 -1.5 .9" material="plain"/>'
NEAR = '<geom type="box" size=".05 .05 .02" pos="0 -2.45 1.47" euler="30 0 0" rgba=".9 .1 .1 1"/>'


def file_of(pixels: np.ndarray) -> bytes:
    """PNG of (H, W, 3) uint8."""
    file = BytesIO()
    imsave(file, pixels)
    return file.getvalue()


def lamp(more: str = "", direction: str = "0 0 -1", name: str = "lamp") -> str:
    return f'<light name="{name}" pos="0 0 3" dir="{direction}" directional="true" {more}/>'


def spot(cutoff: float, more: str = "", exponent: float = 2) -> str:
    return f'<light name="lamp" pos="0 0 2" cutoff="{cutoff}" exponent="{exponent}" {more}/>'


def cloth(name: str, pos: str, more: str) -> str:
    return (
        f'<flexcomp name="{name}" type="grid" count="4 4 1" spacing=".25 .25 .25" dim="2" '
        f'pos="{pos}" radius=".01" {more}><edge equality="true"/></flexcomp>'
    )


def model_of(
    things: str,
    lamps: str = "",
    headlight: str = "",
    extent: float = 3,
    image: str = "",
    **assets: str,
) -> mujoco.MjModel:
    """`image`: a texture or more of the file image.png, before the others."""
    whole = {"texture": "", "material": 'specular="0"', **assets}
    xml = SCENE.format(things=things, lamps=lamps, headlight=headlight, extent=extent, **whole)
    files = {"image.png": file_of(PIXELS)}
    return mujoco.MjModel.from_xml_string(xml.replace("<asset>", f"<asset>{image}"), files)


def both(
    model: mujoco.MjModel, quality: OpenGLQuality = NO_SHADOWS, **tuned: float
) -> tuple[np.ndarray, np.ndarray]:
    """The ray caster's picture and MuJoCo's; `tuned`: fields of the lamp or the plain material."""
    space = ParameterSpace(
        Parameter(
            name=field,
            field=field,
            objects=("lamp" if field.startswith("light") else "plain",),
            component=2 if field == "light_attenuation" else None,
            nominal=0.5,
            low=0.0,
            high=4.0,
            scale="linear",
            unit="",
        )
        for field in tuned
    )
    state, values = initial_state(model), np.array([list(tuned.values())])
    drawn = opengl_or_skip(model, space, "c", SIZE, quality).render(state, values)[0]
    settings = PictureSettings(image_size=SIZE)
    caster = Raycaster(model, space, View("c"), settings, num_threads=1)
    cast = caster.render(state, values)[0]
    return cast.astype(int), drawn.astype(int)


def assert_equal_but_for_edges(cast: np.ndarray, drawn: np.ndarray) -> None:
    assert np.ptp(drawn) > 40  # there is something to see
    assert np.quantile(np.abs(cast - drawn).max(-1), 0.95) <= 2


LACKING = '<light type="point" pos="0 -1 2"/><light type="image" texture="t"/>'
GLOSSY = 'specular="1" shininess=".05"'
SCENES = {
    "sRGB textures, unlike skies": {
        "things": CHECKS,
        "lamps": lamp('diffuse=".5 .5 .5"'),
        "texture": 'colorspace="sRGB"',
    },
    "a shininess of 0": {
        "things": FLOOR + BALL,
        "lamps": lamp(),
        "headlight": DARK,
        "material": 'specular=".5" shininess="0"',
    },
    "a spotlight's own ambient": {
        "things": FINE_FLOOR + BALL,
        "lamps": spot(30, 'ambient=".5 .5 .5" diffuse=".3 .3 .3" attenuation="1 0 .2"'),
        "headlight": DARK,
    },
    "a spotlight that shines everywhere": {
        "things": FINE_FLOOR + BALL,
        "lamps": spot(180, exponent=10),
        "headlight": DARK,
    },
    "a cone wider than OpenGL's": {
        "things": BALL + CUBE,
        "lamps": spot(120, exponent=10),
        "headlight": DARK,
    },
    "a sharper exponent than OpenGL's": {
        "things": FINE_FLOOR + BALL,
        "lamps": spot(60, exponent=200),
        "headlight": DARK,
    },
    "light that is full before it meets a texture": {
        "things": CHECKS,
        "lamps": lamp('castshadow="false"'),
        "headlight": BRIGHT,
    },
    "a highlight on a texture": {
        "things": CHECKS,
        "lamps": lamp(ONLY_GLOSS, direction="0 1 -.8"),
        "headlight": DARK,
        "material": GLOSSY,
    },
    "what is too near": {"things": FLOOR + NEAR, "lamps": lamp(), "extent": 8},
    "a lamp that is off": {
        "things": FLOOR,
        "lamps": lamp('active="false"'),
        "headlight": DARK,
    },
    "lamps of kinds that OpenGL lacks": {
        "things": FLOOR + BALL,
        "lamps": lamp(DIM) + LACKING,
    },
    "no other lamps than such": {"things": FLOOR + BALL, "lamps": LACKING, "headlight": DARK},
    "a texture of one channel": {
        "things": FLOOR + BALL.replace("plain", "grey"),
        "lamps": lamp(),
        "image": GREY,
    },
    "a texture of one channel on a mesh": {
        "things": FLOOR + CUBE.replace("plain", "grey"),
        "lamps": lamp('diffuse=".4 .4 .4"'),
        "image": GREY,
    },
    "a sky of one image": {
        "things": BALL.replace(".5 .5", ".5 -.9").replace('".5"', '".2"'),
        "image": '<texture type="skybox" file="image.png"/>',
    },
    "more lamps than OpenGL has": {
        "things": FLOOR,
        "lamps": "".join(lamp(DIM, name=str(i)) for i in range(12)),
        "headlight": 'diffuse="0 0 0"',
    },
}


@pytest.mark.opengl
@pytest.mark.parametrize("name", SCENES)
def test_the_ray_caster_draws_as_opengl(name):
    assert_equal_but_for_edges(*both(model_of(**SCENES[name])))


@pytest.mark.opengl
def test_lamps_that_cast_shadows_are_full_each_for_itself():
    """MuJoCo draws a picture for each of them."""
    lamps = lamp() + lamp(name="other", direction=".3 0 -1")
    assert_equal_but_for_edges(*both(model_of(CHECKS, lamps, BRIGHT), SHADOWS))


@pytest.mark.opengl
def test_a_shininess_is_tuned_to_0():
    model = model_of(FLOOR + BALL, lamp(), DARK, material='specular=".5" shininess=".5"')
    assert_equal_but_for_edges(*both(model, mat_shininess=0.0))


@pytest.mark.opengl
@pytest.mark.parametrize("things", [FINE_FLOOR + BALL, CUBE], ids=["shapes", "mesh"])
@pytest.mark.parametrize(("own", "tuned"), [(60, 120.0), (120, 60.0)])
def test_a_cone_is_tuned_across_the_widest_that_opengl_takes(things, own, tuned):
    model = model_of(things, spot(own, exponent=10), DARK)
    assert_equal_but_for_edges(*both(model, light_cutoff=tuned))


@pytest.mark.opengl
@pytest.mark.thorough
@pytest.mark.parametrize("things", [BALL, CUBE], ids=["shapes", "mesh"])
def test_an_attenuation_is_tuned(things):
    """The model's own is that of all lamps, for which mujoco_warp compiles none at all."""
    assert_equal_but_for_edges(*both(model_of(things, spot(80), DARK), light_attenuation=4.0))


@pytest.mark.opengl
@pytest.mark.thorough
def test_flexes_have_their_materials_colours_and_groups():
    clothes = [
        cloth("red", "-.8 0 .5", 'material="red"'),
        cloth("painted", "0 0 .5", 'material="red" rgba=".2 .3 .8 1"'),
        cloth("hidden", ".8 0 .5", 'rgba=".9 .9 .9 1"'),
    ]
    model = model_of(FLOOR + "".join(clothes), lamp('diffuse=".5 .5 .5"'))
    model.flex_group[2] = 3
    assert_equal_but_for_edges(*both(model))


@pytest.mark.opengl
@pytest.mark.thorough
def test_a_flex_has_its_textures_mean_colour():
    model = model_of(BALL + cloth("t", "0 -.6 .8", 'material="m"'), lamp(), DARK)
    cast, drawn = both(model)
    model.flex_group[0] = 3
    is_cloth = (drawn != both(model)[1]).any(-1)
    assert is_cloth.mean() > 0.05
    np.testing.assert_allclose(cast[is_cloth].mean(0), drawn[is_cloth].mean(0), atol=4)
