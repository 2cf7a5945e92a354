"""Parameters, their space, and how they are written: one model, a batch, options, colours."""

import copy

import mujoco
import numpy as np
import pytest
from late_actuators import delay
from mujoco.batch import MODEL_FIELDS, Batch

from simtune.errors import InputError, UnknownName
from simtune.parameters import (
    ModelWriter,
    Parameter,
    ParameterSpace,
    camera_pose,
    colour,
    dynamics,
    field_of,
    field_of_view,
)
from simtune.parameters.field import OBJECT_TYPES
from simtune.parameters.fields import FIELDS, KINDS
from simtune.simulation import prepare_spec

XML = """
<mujoco>
  <asset>
    <material name="red" rgba="0.9 0.1 0.2 0.8"/>
    <material name="blue" rgba="0 0 1 1"/>
  </asset>
  <worldbody>
    <light name="lamp" diffuse="0.3 0.3 0.3"/>
    <camera name="oblique" pos="1 -2 0.5" xyaxes="1 0.3 0 -0.1 0.2 1" fovy="50"/>
    <camera name="level" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
    <geom name="floor" type="plane" size="1 1 1" material="blue"/>
    <geom size="0.1" pos="5 0 0" material="blue"/>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" damping="0.5"/>
      <geom name="upper" type="capsule" size="0.05" fromto="0 0 0 0 0 -0.4" material="red"/>
      <site name="mark" rgba="0.1 0.2 0.3 0.4"/>
      <body name="lower" pos="0 0 -0.4">
        <joint name="elbow" axis="0 1 0" damping="0.2"/>
        <geom name="lower" type="capsule" size="0.04" fromto="0 0 0 0 0 -0.3" rgba="0 1 0 1"/>
      </body>
    </body>
    <body name="free" pos="1 0 1">
      <freejoint name="free"/>
      <geom name="free" type="box" size="0.1 0.2 0.3"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="elbow" gear="3"/></actuator>
</mujoco>
"""


def make_model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def own(name, field, objects=(), *, low=None, high=100.0, component=None, nominal=1.0):
    """A parameter without fuss about its bounds."""
    can_be_negative = field.startswith(("opt.", "cam_", "actuator_gear", "actuator_gain"))
    low = (-100.0 if can_be_negative else 0.0) if low is None else low
    return Parameter(
        name=name,
        field=field,
        objects=objects,
        component=component,
        nominal=nominal,
        low=low,
        high=high,
        scale="linear",
        unit="1",
    )


def full_space() -> ParameterSpace:
    return ParameterSpace(
        [
            dynamics("lower_mass", "body_mass", ("lower",), nominal=2.0, unit="kg"),
            dynamics("damping", "dof_damping", ("shoulder", "elbow")),
            dynamics("friction", "geom_friction", ("floor",), nominal=1, unit="1", component=0),
            dynamics("gear", "actuator_gear", ("motor",), nominal=3, unit="1", component=0),
            dynamics("timestep", "opt.timestep", (), nominal=0.002, unit="s"),
            own("gravity", "opt.gravity", component=2, nominal=-9.81),
            *colour("upper", ("upper",), (0.9, 0.1, 0.2)),
            dynamics("light", "light_diffuse", ("lamp",), nominal=0.3, unit="1"),
        ],
        where="the test arm",
    )


def some_values(space, n, seed=0):
    return space.from_unit(np.random.default_rng(seed).uniform(0.1, 0.9, (n, len(space))))


def assert_equal_models(a, b):
    for field in sorted(MODEL_FIELDS):
        if field.startswith("opt."):
            x, y = getattr(a.opt, field[4:]), getattr(b.opt, field[4:])
        else:
            x, y = getattr(a, field), getattr(b, field)
        np.testing.assert_array_equal(x, y, err_msg=field)


def written(parameters, values):
    model = make_model()
    ModelWriter(ParameterSpace(parameters), model).write(model, np.array(values, float))
    return model


class TestSpace:
    def test_to_unit_and_back(self):
        space = full_space()
        unit = np.random.default_rng(0).uniform(size=(5, 3, len(space)))
        np.testing.assert_allclose(space.to_unit(space.from_unit(unit)), unit, atol=1e-12)
        np.testing.assert_allclose(space.to_unit(space.low), 0, atol=1e-12)
        np.testing.assert_allclose(space.to_unit(space.high), 1, atol=1e-12)

    def test_log_scale_is_centred_at_nominal(self):
        space = ParameterSpace([dynamics("mass", "body_mass", ("lower",), nominal=2, unit="kg")])
        assert space.to_unit(space.nominal) == pytest.approx(0.5)
        assert (space.low, space.high) == (pytest.approx(0.2), pytest.approx(20))

    def test_from_unit_stays_within_bounds(self):
        space = full_space()
        for unit in (-1.0, 0.0, 1.0, 2.0):
            values = space.from_unit(np.full(len(space), unit))
            np.testing.assert_allclose(values, space.high if unit >= 1 else space.low)
            assert (space.low <= values).all()
            assert (values <= space.high).all()

    def test_unknown_parameter(self):
        space = ParameterSpace([dynamics("ball_mass", "body_mass", ("b",))], where="ball_in_cup")
        message = r"^no parameter 'bal_mass' in ball_in_cup; did you mean 'ball_mass'\?$"
        with pytest.raises(UnknownName, match=message):
            space["bal_mass"]
        with pytest.raises(UnknownName, match=r"; there are: ball_mass$"):
            space.index("xyz")

    def test_dict(self):
        space = full_space()
        values = space.from_dict({"gear": 4, "upper_r": 0})
        assert values[space.index("gear")] == 4
        assert values[space.index("lower_mass")] == 2
        assert space.from_dict(space.to_dict(values)).tolist() == values.tolist()

    @pytest.mark.parametrize(
        ("value", "message"),
        [
            (31, r"parameter 'gear' must lie in \[0.3, 30\] 1, got 31"),
            (float("nan"), "parameter 'gear' must be a finite number, got nan"),
            ("4", "parameter 'gear' must be a finite number, got '4'"),
            (True, "parameter 'gear' must be a finite number, got True"),
            (None, "parameter 'gear' must be a finite number, got None"),
        ],
    )
    def test_bad_values(self, value, message):
        with pytest.raises(InputError, match=message):
            full_space().from_dict({"gear": value})

    def test_declared_twice(self):
        with pytest.raises(InputError, match="parameter 'a' is declared twice"):
            ParameterSpace([dynamics("a", "body_mass", ("b",)), dynamics("a", "x", ("b",))])


class TestParameter:
    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"scale": "cubic"}, "p: scale must be 'log' or 'linear', got 'cubic'"),
            ({"low": 0.0}, "p: a log scale needs low > 0, got 0.0"),
            ({"low": 3.0}, "p: low must be below high, got 3.0 and 2.0"),
            ({"nominal": 5.0}, r"p: nominal 5.0 lies outside \[0.5, 2.0\]"),
            ({"high": np.inf}, "p: nominal, low and high must be finite numbers"),
        ],
    )
    def test_bad_bounds(self, changes, message):
        fields = {"nominal": 1.0, "low": 0.5, "high": 2.0, "unit": "1"} | changes
        with pytest.raises(InputError, match=message):
            Parameter(name="p", field="body_mass", objects=("b",), **fields)


class TestFields:
    @pytest.mark.parametrize("name", [n for n in FIELDS if not n.startswith("environment.")])
    def test_the_table_is_of_real_numbers_in_mjmodel(self, name):
        field, model = FIELDS[name], make_model()
        assert name in MODEL_FIELDS
        assert np.issubdtype(field.read(model).dtype, np.floating)
        assert field.is_option or field.object_type
        for other in filter(None, (field.carries, field.material_ids)):
            assert len(field_of(other).read(model)) == len(field.read(model))

    @pytest.mark.parametrize("prefix", OBJECT_TYPES)
    def test_object_types_are_counted_and_called_as_in_mujoco(self, prefix):
        owner, model = OBJECT_TYPES[prefix], make_model()
        ids = range(getattr(model, owner.count))
        assert mujoco.mj_id2name(model, owner.mjt, len(ids)) is None
        assert callable(getattr(mujoco.MjSpec(), owner.name))

    @pytest.mark.parametrize(
        ("name", "nominal", "expected"),
        [
            ("body_mass", 2.0, (0.2, 20.0, "log")),
            ("body_mass", 0.0, (None, None, "linear")),
            ("opt.gravity", -9.81, (None, None, "linear")),
            ("geom_rgba", 0.5, (0.0, 1.0, "linear")),
            ("actuator_delay", 0.0, (0.0, None, "linear")),
            ("site_pos", 1.0, (None, None, "linear")),
            ("cam_pos", 1.0, (0.9, 1.1, "linear")),
            ("body_quat", 0.0, (-0.1, 0.1, "linear")),
            ("cam_fovy", 5.0, (1.0, 15.0, "linear")),
            ("cam_fovy", 165.0, (155.0, 170.0, "linear")),
        ],
    )
    def test_usual_ranges(self, name, nominal, expected):
        assert field_of(name).usual_range(nominal) == expected

    @pytest.mark.parametrize(
        ("name", "shows"),
        [
            ("geom_rgba", "appearance"),
            ("light_diffuse", "appearance"),
            ("light_pos", "appearance"),
            ("mat_emission", "appearance"),
            ("cam_quat", "picture"),
            ("geom_size", "picture"),
            ("environment.picture", "picture"),
            ("environment.motion", "motion"),
            ("geom_friction", "motion"),
            ("opt.wind", "motion"),
        ],
    )
    def test_where_a_value_shows(self, name, shows):
        parameter = own("p", name, ("a",), component=0)
        assert field_of(name).shows == shows
        assert parameter.is_visible == (shows != "motion")
        assert parameter.is_appearance == (shows == "appearance")

    def test_a_field_without_an_entry_is_known_by_its_name(self):
        assert (field_of("site_pos").unit, field_of("site_quat").unit) == ("m", "rad")
        assert field_of("body_quat").is_rotation
        assert field_of("eq_data").object_type is OBJECT_TYPES["eq"]
        assert (field_of("opt.wind").object_type, field_of("flex_rgba").object_type) == (None, None)

    def test_each_kind_is_of_one_field(self):
        assert len(KINDS) == len({field.name for field, _ in KINDS.values()})


class TestWriting:
    def test_always_from_nominal(self):
        model, space = make_model(), full_space()
        writer = ModelWriter(space, model)
        first, second = some_values(space, 2)
        writer.write(model, second)
        once = copy.copy(model)
        writer.write(model, second)
        assert_equal_models(model, once)
        writer.write(model, first)
        assert not np.array_equal(model.body_mass, once.body_mass)
        writer.write(model, second)
        assert_equal_models(model, once)

    def test_model_and_batch_agree(self):
        model, space = make_model(), full_space()
        writer, values = ModelWriter(space, model), some_values(space, 3)
        batch = Batch(model, 3, 1)
        for rows in (values[::-1], values):
            writer.write_batch(batch, rows)
        for sim in range(3):
            alone = make_model()
            writer.write(alone, values[sim])
            assert_equal_models(batch.get_model(sim), alone)
        assert_equal_models(model, make_model())  # the model that was read is left alone

    def test_mass_carries_inertia_and_constants(self):
        nominal = make_model()
        body = nominal.body("free").id
        mass = 3 * nominal.body_mass[body]
        model = written([own("m", "body_mass", ("free",))], [mass])
        np.testing.assert_allclose(model.body_mass[body], mass)
        np.testing.assert_allclose(model.body_inertia[body], 3 * nominal.body_inertia[body])
        np.testing.assert_allclose(model.body_invweight0[body], nominal.body_invweight0[body] / 3)
        others = np.arange(model.nbody) != body
        np.testing.assert_array_equal(model.body_inertia[others], nominal.body_inertia[others])

    def test_derived_constants_are_those_of_a_model_compiled_so(self):
        """A heavier arm: as if its geoms' densities were in the file."""
        spec = mujoco.MjSpec.from_string(XML)
        for name in ("upper", "lower"):
            spec.geom(name).density *= 4
        compiled = spec.compile()
        model = written([own("m", "body_mass", ("upper", "lower"))], [4])
        for field in ("body_mass", "body_inertia", "body_subtreemass"):
            np.testing.assert_allclose(getattr(model, field), getattr(compiled, field))
        for field in ("dof_invweight0", "body_invweight0", "dof_M0", "actuator_acc0"):
            np.testing.assert_allclose(getattr(model, field), getattr(compiled, field))
            assert not np.allclose(getattr(model, field), getattr(make_model(), field)), field

    @pytest.mark.parametrize(
        ("joint", "name", "field"),
        [
            ('type="ball"', "top", "body_ipos"),
            ('type="ball"', "spin", "jnt_pos"),
            ('type="slide"/> <joint type="slide" axis="1 0 0"', "spin", "jnt_axis"),
        ],
    )
    def test_a_simple_body_moves_as_in_a_model_compiled_so(self, joint, name, field):
        def moved(model: mujoco.MjModel) -> np.ndarray:
            data = mujoco.MjData(model)
            data.qvel[:] = 1.0
            mujoco.mj_step(model, data, 100)
            return data.qpos

        spec = mujoco.MjSpec.from_string(
            f"""<mujoco><worldbody><body name="top"><joint name="spin" {joint}/>
            <geom name="box" type="box" size=".1 .2 .3"/></body></worldbody></mujoco>"""
        )
        space = ParameterSpace([own("p", field, (name,), component=0, nominal=0.0)])
        with pytest.raises(InputError, match="p: the model was compiled with a simple body there"):
            ModelWriter(space, spec.compile())
        prepared = spec.copy()
        prepare_spec(prepared, space, step_s=0.02)
        model = prepared.compile()
        ModelWriter(space, model).write(model, np.array([0.5]))
        if field == "jnt_axis":
            spec.joint(name).axis = [0.5, 0, 1]
        else:
            (spec.joint(name) if name == "spin" else spec.geom("box")).pos = [0.5, 0, 0]
        np.testing.assert_allclose(moved(model), moved(spec.compile()), atol=1e-9)

    def test_directions_get_a_length_of_1(self):
        field = own("tilt", "light_dir", ("lamp",), component=0, nominal=0.0)
        model = written([field], [1.0])
        np.testing.assert_allclose(model.light_dir[0], [0.5**0.5, 0, -(0.5**0.5)])

    def test_fields_of_controls_are_refused_where_actuators_have_several(self):
        two = '<actuator><pid joint="elbow" kp="1" input="pos vel"/>'
        model = mujoco.MjModel.from_xml_string(XML.replace("<actuator>", two))
        space = ParameterSpace([own("end", "actuator_ctrlrange", ("motor",), component=1)])
        with pytest.raises(
            InputError, match="actuator_ctrlrange cannot be tuned in this model, in"
        ):
            ModelWriter(space, model)
        gear = ParameterSpace([own("gear", "actuator_gear", ("motor",), component=0)])
        ModelWriter(gear, model).write(model, np.array([7]))
        np.testing.assert_array_equal(model.actuator_gear[:, 0], [1, 7])

    def test_an_inertia_of_its_own_beats_the_masss(self):
        parameters = [
            own("inertia", "body_inertia", ("free",), component=0),
            own("m", "body_mass", ("free",)),
        ]
        mass = make_model().body("free").mass[0]
        for order in (parameters, parameters[::-1]):
            values = [7.0 if p.name == "inertia" else 2 * mass for p in order]
            inertia = written(order, values).body("free").inertia
            np.testing.assert_allclose(inertia[0], 7)
            np.testing.assert_allclose(inertia[1:], 2 * make_model().body("free").inertia[1:])

    def test_one_object_is_absolute_and_several_are_a_factor(self):
        model = written([own("d", "dof_damping", ("elbow",))], [4])
        assert model.dof_damping[:2].tolist() == [0.5, 4]
        model = written([own("d", "dof_damping", ("shoulder", "elbow"))], [4])
        np.testing.assert_allclose(model.dof_damping[:2], [2, 0.8])

    def test_a_joint_may_have_several_dofs(self):
        model = written([own("d", "dof_damping", ("free",))], [4])
        assert model.joint("free").damping.tolist() == [4] * 6
        assert model.dof_damping[:2].tolist() == [0.5, 0.2]

    @pytest.mark.parametrize("how", ["model", "batch"])
    def test_options(self, how):
        space = ParameterSpace(
            [
                own("timestep", "opt.timestep"),
                own("gravity", "opt.gravity", component=2, nominal=-9.81),
                own("wind", "opt.wind"),
            ]
        )
        model = make_model()
        writer, values = ModelWriter(space, model), np.array([0.004, -1.62, 3])
        if how == "model":
            writer.write(model, values)
        else:
            batch = Batch(model, 2, 1)
            writer.write_batch(batch, np.stack([space.nominal, values]))
            assert batch.get_model(0).opt.gravity[2] == -9.81
            model = batch.get_model(1)
        assert model.opt.timestep == 0.004
        assert model.opt.gravity.tolist() == [0, 0, -1.62]
        assert model.opt.wind.tolist() == [3, 3, 3]

    def test_timestep_changes_the_motion_of_a_batch(self):
        space = ParameterSpace([dynamics("timestep", "opt.timestep", (), nominal=0.002, unit="s")])
        batch = Batch(make_model(), 2, 1)
        ModelWriter(space, make_model()).write_batch(batch, np.array([[0.002], [0.004]]))
        batch.step()
        assert batch.time.tolist() == [0.002, 0.004]


def camera_rotation(model: mujoco.MjModel, camera: str) -> np.ndarray:
    """(3, 3) the camera's axes in the world, columns: to the right, up, back."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    return data.camera(camera).xmat.reshape(3, 3).copy()


def rotation(axis: int, angle: float) -> np.ndarray:
    """(3, 3) of a turn about x, y or z, written out by hand."""
    cos, sin = np.cos(angle), np.sin(angle)
    following, last = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[following, following] = matrix[last, last] = cos
    matrix[last, following], matrix[following, last] = sin, -sin
    return matrix


class TestCamera:
    def pose(self, values, names=("x", "y", "z", "pitch", "yaw", "roll"), shuffled=False):
        """A model whose oblique camera stands and looks like that."""
        space = camera_pose("camera", "oblique", (1, -2, 0.5))
        assert [p.name for p in space] == [f"camera_{n}" for n in names]
        order = [5, 3, 0, 4, 2, 1] if shuffled else list(range(6))
        return written([space[i] for i in order], np.array(values)[order])

    def test_nominal_values_change_nothing(self):
        model, nominal = self.pose([1, -2, 0.5, 0, 0, 0]), make_model()
        np.testing.assert_array_equal(model.cam_pos, nominal.cam_pos)
        np.testing.assert_allclose(model.cam_quat, nominal.cam_quat, atol=1e-15)

    @pytest.mark.parametrize("shuffled", [False, True])
    def test_turns_compose_in_the_order_x_y_z_about_the_cameras_own_axes(self, shuffled):
        pitch, yaw, roll = 0.1, -0.3, 0.7
        model = self.pose([1.1, -2.1, 0.4, pitch, yaw, roll], shuffled=shuffled)
        expected = camera_rotation(make_model(), "oblique")
        for axis, angle in enumerate((pitch, yaw, roll)):
            expected = expected @ rotation(axis, angle)
        np.testing.assert_allclose(camera_rotation(model, "oblique"), expected, atol=1e-12)
        np.testing.assert_allclose(model.camera("oblique").pos, [1.1, -2.1, 0.4])
        np.testing.assert_array_equal(
            camera_rotation(model, "level"), camera_rotation(make_model(), "level")
        )

    def test_pitch_looks_up_and_yaw_to_the_left(self):
        ahead = -camera_rotation(make_model(), "level")[:, 2]
        np.testing.assert_allclose(ahead, [0, 1, 0], atol=1e-12)
        for component, seen in (
            (0, [0, np.cos(0.1), np.sin(0.1)]),
            (1, [-np.sin(0.1), np.cos(0.1), 0]),
        ):
            turn = own("turn", "cam_quat", ("level",), component=component, nominal=0.0)
            looks = -camera_rotation(written([turn], [0.1]), "level")[:, 2]
            np.testing.assert_allclose(looks, seen, atol=1e-12)

    def test_an_angle_on_several_objects_is_no_factor(self):
        turn = own("turn", "cam_quat", ("oblique", "level"), component=2, nominal=0.0)
        model = written([turn], [0.4])
        for camera in ("oblique", "level"):
            expected = camera_rotation(make_model(), camera) @ rotation(2, 0.4)
            np.testing.assert_allclose(camera_rotation(model, camera), expected, atol=1e-12)

    def test_a_batch_is_turned_as_a_model_is(self):
        space = ParameterSpace(
            [*camera_pose("camera", "oblique", (1, -2, 0.5)), field_of_view("fov", "oblique", 50)]
        )
        model, values = make_model(), some_values(space, 3)
        batch = Batch(model, 3, 1)
        ModelWriter(space, model).write_batch(batch, values)
        for sim in range(3):
            alone = written(space.parameters, values[sim])
            assert alone.camera("oblique").fovy[0] == pytest.approx(values[sim, -1])
            assert_equal_models(batch.get_model(sim), alone)

    @pytest.mark.parametrize("component", [None, 3])
    def test_a_turn_needs_an_axis(self, component):
        with pytest.raises(InputError, match="turn: cam_quat needs a component, the axis to turn"):
            own("turn", "cam_quat", ("level",), component=component)

    def test_two_turns_about_one_axis_are_refused(self):
        turns = [own(n, "cam_quat", ("level",), component=1, nominal=0.0) for n in "ab"]
        with pytest.raises(InputError, match="a and b write the same cam_quat"):
            written(turns, [0, 0])

    def test_poses_and_fields_of_view_show_in_single_pictures(self):
        assert all(p.is_visible for p in camera_pose("camera", "level", (0, -2, 0)))
        assert field_of_view("fov", "level", 45).is_visible


class TestDelays:
    def remembering(self, num_samples: int) -> mujoco.MjModel:
        spec = mujoco.MjSpec.from_string(XML)
        spec.actuator("motor").nsample = num_samples
        return spec.compile()

    def test_a_delay_is_absolute_seconds_and_does_not_show_in_a_picture(self):
        late = delay("late", ("motor",), 0.01)
        assert not late.is_factor
        assert not delay("late", ("motor", "other"), 0.01).is_factor
        assert not late.is_visible
        model = self.remembering(5)  # of 0.002 s
        ModelWriter(ParameterSpace([late]), model).write(model, np.array([0.007]))
        assert model.actuator_delay.tolist() == [0.007]

    @pytest.mark.parametrize("num_samples", [0, 4])
    def test_what_the_model_would_forget_is_refused(self, num_samples):
        space = ParameterSpace([delay("late", ("motor",), 0.01)])
        message = r"late: the model remembers controls for 0(\.008)? s, less than .* of 0.01 s"
        with pytest.raises(InputError, match=message):
            ModelWriter(space, self.remembering(num_samples))

    def test_a_negative_delay_is_refused(self):
        with pytest.raises(
            InputError, match="late: actuator_delay cannot be negative, got low = -"
        ):
            own("late", "actuator_delay", ("motor",), low=-0.1)


class TestColours:
    def test_absolute_also_on_several_objects(self):
        model = written(colour("arm", ("upper", "lower"), (0.9, 0.1, 0.2)), [0.2, 0.3, 0.4])
        for name in ("upper", "lower"):
            np.testing.assert_array_equal(model.geom(name).rgba[:3], np.float32([0.2, 0.3, 0.4]))

    def test_grey_is_not_given_back_to_the_material(self):
        """MuJoCo draws a geom of rgba (.5, .5, .5, 1) in its material's colour."""
        model = written(colour("floor", ("floor",), (0, 0, 1)), [0.5, 0.5, 0.5])
        rgba = model.geom("floor").rgba
        assert not (rgba == 0.5).all(where=[True, True, True, False])
        np.testing.assert_allclose(rgba, [0.5, 0.5, 0.5, 1], atol=1e-6)

    def test_other_geoms_keep_their_materials(self):
        model = written(colour("lower", ("lower",), (0, 1, 0)), [0.5, 0.5, 0.5])
        lower = model.geom("lower").id
        others = np.arange(model.ngeom) != lower
        np.testing.assert_array_equal(model.geom_rgba[others], make_model().geom_rgba[others])

    def test_one_channel_leaves_the_materials_others(self):
        """The geom is drawn in its material's colour, which is what it starts from."""
        model = written([own("r", "geom_rgba", ("upper",), component=0, nominal=0.9)], [0.3])
        np.testing.assert_array_equal(model.geom("upper").rgba, np.float32([0.3, 0.1, 0.2, 0.8]))

    def test_a_grey_leaves_alpha(self):
        model = written([own("grey", "site_rgba", ("mark",), nominal=0.1)], [0.7])
        np.testing.assert_array_equal(model.site("mark").rgba, np.float32([0.7, 0.7, 0.7, 0.4]))

    def test_light(self):
        model = written([dynamics("l", "light_diffuse", ("lamp",), nominal=0.3)], [0.6])
        np.testing.assert_array_equal(model.light("lamp").diffuse, np.float32([0.6] * 3))


class TestMessages:
    @pytest.mark.parametrize(
        ("field", "objects", "component", "message"),
        [
            ("body_mas", ("free",), None, "no field 'body_mas' in MjModel; did you mean 'body_m"),
            ("body_mass", ("fre",), None, "no body 'fre' in the model; did you mean 'free'"),
            ("geom_rgba", ("uper",), 0, "no geom 'uper' in the model; did you mean 'upper'"),
            ("dof_damping", ("elbo",), None, "no joint 'elbo' in the model; did you mean 'elbow'"),
            ("body_mass", (), None, "p: body_mass needs the names of its objects"),
            ("key_qpos", ("x",), None, "p: key_qpos cannot be written; fields of these can: body"),
            ("body_mass", ("free",), 1, "p: body_mass has no component 1"),
            ("geom_rgba", ("free",), 4, "p: geom_rgba has no component 4"),
            ("opt.gravity", (), 3, "p: opt.gravity has no component 3"),
            ("opt.timestep", (), 0, "p: opt.timestep has no component 0"),
            ("opt.gravity", ("free",), 2, "p: opt.gravity has no objects, got free"),
        ],
    )
    def test_what_the_model_lacks(self, field, objects, component, message):
        with pytest.raises(InputError, match=message):
            written([own("p", field, objects, component=component)], [1])

    def test_two_parameters_of_one_number(self):
        parameters = [
            own("all", "body_mass", ("upper", "lower")),
            own("one", "body_mass", ("lower",)),
        ]
        with pytest.raises(InputError, match="all and one write the same body_mass"):
            written(parameters, [1, 1])

    def test_shapes(self):
        model, space = make_model(), full_space()
        writer, n = ModelWriter(space, model), len(space)
        with pytest.raises(ValueError, match=rf"parameters must be \({n},\), got \(2,\)"):
            writer.write(model, np.ones(2))
        message = rf"parameters must be \(3, {n}\), got \({n},\)"
        with pytest.raises(ValueError, match=message):
            writer.write_batch(Batch(model, 3, 1), np.ones(n))


def test_a_sum_is_shared_as_before_and_of_one_object_is_its_own():
    model = make_model()
    for objects, size, expected in (
        (("lower",), 0.06, [0.06]),
        (("upper", "lower"), 0.18, [0.1, 0.08]),
    ):
        at = [model.geom(name).id for name in objects]
        bounds = {"nominal": model.geom_size[at, 0].sum(), "low": 0.01, "high": 1.0, "unit": "m"}
        rope = Parameter(
            name="r", field="geom_size", objects=objects, component=0, is_sum=True, **bounds
        )
        written = copy.copy(model)
        ModelWriter(ParameterSpace([rope]), model).write(written, np.array([size]))
        np.testing.assert_allclose(written.geom_size[at, 0], expected)


def test_masks_of_no_parameters_are_masks():
    space = ParameterSpace([])
    for mask in ("is_log", "is_colour", "is_visible", "is_appearance", "is_delay"):
        assert getattr(space, mask).dtype == bool
