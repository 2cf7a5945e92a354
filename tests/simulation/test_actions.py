"""What actions do: each mapping against a plain MuJoCo loop, and what cannot be mapped."""

from functools import partial

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from simtune.checking.welds import turning_welds
from simtune.errors import InputError, UnknownName
from simtune.parameters import ModelWriter, ParameterSpace, dynamics
from simtune.simulation import (
    DirectActions,
    JointActions,
    MocapActions,
    PictureSettings,
    ScaledActions,
    Scene,
    Simulator,
    random_actions,
)
from simtune.simulation.mocap import find_held
from simtune.simulation.servos import control_limits

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
ARM = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <camera name="front" pos="0 -2 0.5" xyaxes="1 0 0 0 0 1"/>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="1"/>
      <geom name="upper" type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" damping="1"/>
        <geom name="lower" type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="20" ctrllimited="true" ctrlrange="-2 1"/>
    <position name="elbow" joint="elbow" kp="10" ctrllimited="true" ctrlrange="0 3"/>
    <motor name="free" joint="elbow"/>
  </actuator>
</mujoco>
"""
SERVOS = ("shoulder", "elbow")
# The mocap body is turned, and held where neither body has its middle.
HAND = """
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <camera name="front" pos="0 -2 0.5" xyaxes="1 0 0 0 0 1"/>
    <body name="target" mocap="true" pos="0.1 0.2 0.5" quat="0.8 0 0.6 0"/>
    <body name="plain" mocap="true"/>
    <body name="hand" pos="0.1 0.2 0.5" gravcomp="1">
      <freejoint/>
      <geom name="hand" type="box" size="0.05 0.03 0.02" mass="1"/>
      <site name="grip" pos="0.02 0 0.05"/>
      <body name="weight" pos="0 0 -0.1">
        <joint name="swing" axis="0 1 0"/>
        <geom name="weight" size="0.02" pos="0 0 -0.1" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <equality>{weld}</equality>
  <actuator><motor name="spin" joint="swing"/></actuator>
</mujoco>
"""
WELDS = {
    "mocap first": '<weld body1="target" body2="hand"/>',
    "mocap second": '<weld body1="hand" body2="target"/>',
    "anchored": '<weld body1="target" body2="hand" anchor=".02 .01 0" relpose=".1 0 0 1 0 0 0"/>',
    "connected": '<connect body1="hand" body2="target" anchor="0.03 0 0.01"/>',
}


def simulator_of(
    xml: str, map_actions=DirectActions, initialize=None, step_s: float = 0.05
) -> Simulator:
    model = mujoco.MjModel.from_xml_string(xml)
    geom_body = model.body(model.nbody - 1).name
    mass = dynamics("mass", "body_mass", (geom_body,), nominal=1.0, unit="kg")
    scene = Scene(
        model=model,
        space=ParameterSpace([mass]),
        initialize=initialize or (lambda batch, rng: None),
        step_s=step_s,
        map_actions=map_actions,
    )
    return Simulator(scene, PictureSettings(image_size=16))


def plain_loop(simulator: Simulator, mass: float, start, move, num_steps: int) -> np.ndarray:
    """(T + 1, S) states by nothing but mj_step; `move(t, model, data)` sets what actions do."""
    model = mujoco.MjModel.__copy__(simulator.model)
    ModelWriter(simulator.space, model).write(model, np.array([mass]))
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, start, STATE)
    mujoco.mj_forward(model, data)
    states = [start.copy()]
    for t in range(num_steps):
        move(t, model, data)
        mujoco.mj_step(model, data, simulator.num_substeps)
        states.append(np.empty_like(start))
        mujoco.mj_getState(model, data, states[-1], STATE)
        mujoco.mj_forward(model, data)
    return np.array(states)


def roll_out(simulator: Simulator, seed: int = 0, num: int = 3, num_steps: int = 12):
    rng = np.random.default_rng(seed)
    actions = random_actions(num, num_steps, simulator.action_mapping, rng, hold=2)
    return simulator.roll_out(rng.uniform(0.5, 2, (num, 1)), actions, rng)


def assert_as_plain(simulator: Simulator, control) -> None:
    """`control(action, data)` changes the data before each step."""
    rollouts = roll_out(simulator)
    assert len(rollouts) == 3
    for parameters, states, actions in zip(
        rollouts.parameters, rollouts.states, rollouts.actions, strict=True
    ):

        def move(t, model, data, actions=actions):
            control(actions[t], data)

        expected = plain_loop(simulator, parameters[0], states[0], move, len(actions))
        physics = 1 + simulator.model.nq + simulator.model.nv
        np.testing.assert_allclose(states[:, :physics], expected[:, :physics], rtol=0, atol=1e-9)


class TestControls:
    def test_direct(self):
        def control(action, data):
            data.ctrl[:] = action

        simulator = simulator_of(ARM)
        assert simulator.num_actions == 3
        assert_as_plain(simulator, control)
        np.testing.assert_array_equal(simulator.action_mapping.range, [[-2, 1], [0, 3], [-1, 1]])
        np.testing.assert_array_equal(simulator.action_scale, [2, 3, 1])

    def test_direct_some_in_another_order(self):
        def start(batch, rng):
            batch.ctrl[:, 2] = 0.3  # kept, since no action is its

        def control(action, data):
            data.ctrl[:] = action[1], action[0], 0.3

        mapping = partial(DirectActions, actuators=("elbow", "shoulder"))
        simulator = simulator_of(ARM, mapping, start)
        assert simulator.action_mapping.names == ("elbow", "shoulder")
        assert simulator.num_actions == 2
        assert_as_plain(simulator, control)

    def test_scaled_covers_the_controls_ranges(self):
        def control(action, data):
            data.ctrl[:2] = -0.5 + 1.5 * action[0], 1.5 + 1.5 * action[1]

        mapping = partial(ScaledActions, actuators=("shoulder", "elbow"))
        simulator = simulator_of(ARM, mapping)
        np.testing.assert_array_equal(simulator.action_mapping.range, [[-1, 1]] * 2)
        assert_as_plain(simulator, control)

    def test_scaled_from_other_ranges(self):
        def control(action, data):
            data.ctrl[:2] = -2 + 3 * (action[0] + 100) / 200, 3 * action[1] / 100

        mapping = partial(
            ScaledActions, actuators=("shoulder", "elbow"), action_range=[[-100, 100], [0, 100]]
        )
        simulator = simulator_of(ARM, mapping)
        np.testing.assert_array_equal(simulator.action_scale, [100, 100])
        assert_as_plain(simulator, control)

    def test_scaled_by_gain_and_offset(self):
        def control(action, data):
            data.ctrl[:] = 0.1 + np.radians(action[0]), -0.2 - action[1], 2 * action[2]

        mapping = partial(ScaledActions, gain=[np.pi / 180, -1, 2], offset=[0.1, -0.2, 0])
        simulator = simulator_of(ARM, mapping)
        expected = [np.degrees([-2.1, 0.9]), [-3.2, -0.2], [-1, 1]]
        np.testing.assert_allclose(simulator.action_mapping.range, expected)
        np.testing.assert_array_equal(simulator.action_mapping.is_limited, [True, True, False])
        assert_as_plain(simulator, control)

    def test_controls_beyond_their_range_act_where_the_model_does_not_clip_them(self):
        """With `clampctrl` off, a slow servo also remembers having been held beyond its range."""
        slow = ARM.replace('ctrlrange="-2 1"', 'ctrlrange="-2 1" timeconst=".1"')
        options = 'timestep="0.005"><flag clampctrl="disable"/></option>'
        simulator = simulator_of(slow.replace('timestep="0.005"/>', options))
        mapping = simulator.action_mapping
        assert not mapping.is_limited.any()
        np.testing.assert_array_equal(mapping.range, [[-2, 1], [0, 3], [-1, 1]])
        assert control_limits(simulator.model, 0) == (-np.inf, np.inf)
        assert not ScaledActions(simulator.model, actuators=SERVOS).is_limited.any()
        actions = np.tile([1.6, 3.5, 0.0], (1, 4, 1))
        states = simulator.roll_out(np.ones((1, 1)), actions, np.random.default_rng(0)).states
        assert states[0, 0, simulator.state_space.remembered] == 1.6

        def move(t, model, data):
            data.ctrl[:] = actions[0, t]

        plain = plain_loop(simulator, 1.0, states[0, 0], move, 4)
        np.testing.assert_allclose(states[0], plain, atol=1e-9)

    def test_joints_are_displaced_from_where_they_are(self):
        def control(action, data):
            elbow, shoulder = 0.2 * np.clip(action[0], -1, 1), 0.1 * np.clip(action[1], -1, 1)
            data.ctrl[:2] = 2 * (data.qpos[0] + shoulder), data.qpos[1] + elbow

        mapping = partial(JointActions, actuators=("elbow", "shoulder"), per_unit=[0.2, 0.1])
        geared = ARM.replace('kp="20"', 'kp="20" gear="2"')
        simulator = simulator_of(geared, mapping)
        np.testing.assert_array_equal(simulator.action_mapping.range, [[-1, 1]] * 2)
        assert simulator.action_mapping.is_limited.all()
        assert_as_plain(simulator, control)

    def test_no_action_displaces_nothing_whatever_a_worlds_gear(self):
        simulator = simulator_of(ARM, partial(JointActions, actuators=SERVOS))
        batch = Batch(simulator.model, 2)
        batch.expand("actuator_gear")[1, :, 0] = 3.0
        batch.qpos[...] = 0.4
        controls = simulator.action_mapping.apply(batch, np.zeros((2, simulator.num_actions)))
        np.testing.assert_allclose(controls[1], 3 * controls[0])

    @pytest.mark.parametrize(
        ("mapping", "message"),
        [
            (partial(DirectActions, actuators=("elbo",)), "no actuator 'elbo'.*mean 'elbow'"),
            (partial(DirectActions, actuators=("free", "free")), "'free' is named twice"),
            (partial(ScaledActions, actuators=("elbo",)), "no actuator 'elbo'"),
            (ScaledActions, "free has no ctrlrange for the actions to cover: give a gain"),
            (partial(JointActions, actuators=("elbo",)), "no actuator 'elbo'"),
            (JointActions, "free is no servo of positions .<position>.*another mapping"),
            (partial(JointActions, actuators=SERVOS, per_unit=[1]), "per_unit .* number, or 2 of"),
            (partial(ScaledActions, gain=[1, 2]), "gain must be a number, or 3 of.*got .1, 2"),
            (partial(ScaledActions, gain=[[1, 2]]), "gain must be a number, or 3 of them"),
            (
                partial(ScaledActions, gain=1, offset=[1, 2]),
                "offset must be a number, or 3 of them",
            ),
            (partial(ScaledActions, gain=[1, 0, 1]), "gain of 0 moves nothing"),
            (partial(ScaledActions, gain=1, action_range=[1, 0]), "low must be below its high"),
            (partial(ScaledActions, gain=1, action_range=[1, 2, 3]), r"range \[low, high\] or 3"),
        ],
    )
    def test_what_cannot_be(self, mapping, message):
        with pytest.raises(InputError, match=message):
            mapping(mujoco.MjModel.from_xml_string(ARM))


def test_joint_actions_refuse_an_actuator_that_moves_a_tendon():
    model = mujoco.MjModel.from_xml_string(
        ARM.replace(
            "</worldbody>",
            "</worldbody><tendon><fixed name='both'><joint joint='elbow' "
            "coef='1'/></fixed></tendon>",
        ).replace('<motor name="free" joint="elbow"/>', '<motor name="free" tendon="both"/>')
    )
    with pytest.raises(InputError, match="free moves no hinge and no slide"):
        JointActions(model)


# No control, and two
IDLE = '<dcmotor name="idle" joint="elbow" motorconst="1" resistance="1" input="none"/>'
PID = '<pid name="pid" joint="elbow" kp="3" input="pos vel"/>'


def test_actuators_with_other_than_one_control_leave_the_others_theirs():
    def control(action, data):
        data.ctrl[2:4] = data.qpos[:2] + np.clip(action, -1, 1)

    xml = ARM.replace("<actuator>", f"<actuator>{IDLE}{PID}")
    for mapping in (DirectActions, ScaledActions):
        simulator = simulator_of(xml, partial(mapping, actuators=SERVOS))
        expected = [[-2, 1], [0, 3]] if mapping is DirectActions else [[-1, 1]] * 2
        np.testing.assert_array_equal(simulator.action_mapping.range, expected)
    assert_as_plain(simulator_of(xml, partial(JointActions, actuators=SERVOS)), control)
    every = DirectActions(mujoco.MjModel.from_xml_string(xml.replace(PID, "")))
    assert every.names == ("shoulder", "elbow", "free")


@pytest.mark.parametrize(("actuator", "num"), [(IDLE, 0), (PID, 2)])
def test_an_actuator_with_other_than_one_control_is_no_action(actuator, num):
    model = mujoco.MjModel.from_xml_string(ARM.replace("<actuator>", f"<actuator>{actuator}"))
    name = model.actuator(0).name
    message = f"^actuator '{name}' has {num} controls, and an action is one: leave it out, by act"
    with pytest.raises(InputError, match=message):
        JointActions(model, actuators=("shoulder", name))
    if num:
        with pytest.raises(InputError, match=message):
            DirectActions(model)


class TestMocap:
    @pytest.mark.parametrize("weld", WELDS)
    def test_the_body_goes_where_it_is_sent(self, weld):
        """In steps that are long for a weld, and without gravity."""
        mapping = partial(MocapActions, body="target", metres_per_unit=0.02)
        xml = HAND.format(weld=WELDS[weld]).replace("<option", '<option gravity="0 0 0"')
        simulator = simulator_of(xml, mapping, step_s=0.4)
        held = find_held(simulator.model, "target")
        actions = np.array([[[1.0, 0, 0], [0, 0, 0]], [[0.5, -1, 0.25], [-0.5, 0, 1]]])
        places = simulator.roll_out(
            np.full((2, 1), 0.01), actions, np.random.default_rng(0), held.place
        ).observed
        np.testing.assert_allclose(np.diff(places, axis=1), 0.02 * actions, atol=5e-4)

    @pytest.mark.parametrize("weld", WELDS)
    def test_a_weld_that_turns_the_hand_at_once_is_told(self, weld):
        """By the mocap body's own 2 asin 0.6, where a relpose says that the hand has none."""
        mapping = partial(MocapActions, body="target")
        scaled = WELDS[weld].replace("relpose", 'torquescale="0.5" relpose')
        said = turning_welds(simulator_of(HAND.format(weld=scaled), mapping), seed=0)
        told = "the weld of target turns hand by 1.3 rad (74°) from how episodes begin"
        assert [told in its for its in said] == [True] * (weld == "anchored")
        direct = simulator_of(HAND.format(weld=WELDS[weld]))
        assert turning_welds(direct, seed=0) == []

    @pytest.mark.parametrize("weld", WELDS)
    def test_as_a_plain_loop(self, weld):
        """Where the mocap body has to be is found by a solver: no force is left in the weld."""
        mapping = partial(MocapActions, body="target", axes="xz", metres_per_unit=0.025)
        simulator = simulator_of(HAND.format(weld=WELDS[weld]), mapping)

        def control(action, data):
            self.hold(simulator.model, data)
            data.mocap_pos[0, [0, 2]] += 0.025 * action
            data.mocap_pos[0, 1] = kept

        kept = roll_out(simulator).states[0, 0]
        data = mujoco.MjData(simulator.model)
        mujoco.mj_setState(simulator.model, data, kept, STATE)
        kept = data.mocap_pos[0, 1]
        assert_as_plain(simulator, control)

    @staticmethod
    def hold(model, data) -> None:
        """Newton's method on MuJoCo's own residual, which is linear in the place."""
        for _ in range(2):
            mujoco.mj_forward(model, data)
            residual = data.efc_pos[:3].copy()
            slope = np.empty((3, 3))
            for axis in range(3):
                data.mocap_pos[0, axis] += 1e-3
                mujoco.mj_forward(model, data)
                slope[:, axis] = (data.efc_pos[:3] - residual) / 1e-3
                data.mocap_pos[0, axis] -= 1e-3
            data.mocap_pos[0] -= np.linalg.solve(slope, residual)
        mujoco.mj_forward(model, data)

    def test_actions_and_places_are_clipped(self):
        mapping = partial(
            MocapActions,
            body="target",
            action_range=[-0.5, 0.5],
            workspace_m=[[0.0, 0.2], [0.15, np.inf], [-np.inf, 0.6]],
        )
        simulator = simulator_of(HAND.format(weld=WELDS["mocap first"]), mapping)
        actions = np.array([[[9.0, -9.0, 9.0]], [[0.05, 0.4, -9.0]]])
        rollouts = simulator.roll_out(np.ones((2, 1)), actions, np.random.default_rng(0))
        for states, expected in zip(
            rollouts.states, ([0.2, 0.15, 0.6], [0.15, 0.6, 0.0]), strict=True
        ):
            data = mujoco.MjData(simulator.model)
            mujoco.mj_setState(simulator.model, data, states[1], STATE)
            np.testing.assert_allclose(data.mocap_pos[0], expected, atol=1e-12)

    def test_what_an_action_does_depends_on_the_present_state_only(self):
        """A fit replays stretches of episodes with a mocap body left where another one was."""
        mapping = partial(MocapActions, body="target", axes="xy")
        simulator = simulator_of(HAND.format(weld=WELDS["anchored"]), mapping)
        rng = np.random.default_rng(0)
        actions = rng.uniform(-0.02, 0.02, (2, 8, 2))
        rollouts = simulator.roll_out(np.ones((2, 1)), actions, rng)
        starts = rollouts.states[:, 4].copy()
        data, size = mujoco.MjData(simulator.model), mujoco.mj_stateSize(simulator.model, STATE)
        for start in starts:
            mujoco.mj_setState(simulator.model, data, start, STATE)
            data.mocap_pos[0, :2] = 5
            full = np.empty(size)
            mujoco.mj_getState(simulator.model, data, full, STATE)
            start[:] = full
        again = simulator.roll_out(np.ones((2, 1)), actions[:, 4:], rng, starts=starts)
        physics = slice(1, 1 + simulator.model.nq + simulator.model.nv)
        np.testing.assert_allclose(
            again.states[:, :, physics], rollouts.states[:, 4:, physics], atol=1e-9
        )

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"body": "taget"}, "no mocap body 'taget'.*did you mean 'target'"),
            ({"body": "hand"}, "no mocap body 'hand'"),
            ({"body": "plain"}, "nothing is welded to mocap body 'plain'"),
            ({"body": "target", "axes": "xx"}, "axes must be some of x, y and z.*got 'xx'"),
            ({"body": "target", "axes": ""}, "axes must be some of"),
            ({"body": "target", "workspace_m": [[0, 1]] * 2}, "or 3 of them"),
            ({"body": "target", "workspace_m": [[0, 1], [1, 0], [0, 1]]}, "low must be below"),
        ],
    )
    def test_what_cannot_be(self, given, message):
        model = mujoco.MjModel.from_xml_string(HAND.format(weld=WELDS["mocap first"]))
        with pytest.raises(InputError, match=message):
            MocapActions(model, **given)
        with pytest.raises(UnknownName):
            MocapActions(model, body="hand")

    def test_no_mocap_body(self):
        with pytest.raises(InputError, match="no named mocap body, so none 'target'"):
            MocapActions(mujoco.MjModel.from_xml_string(ARM), body="target")


INTEGRATING = '<intvelocity name="elbow" joint="elbow" kp="10" actrange="-1 1"/>'
OTHER_GAIN = (
    '<general name="elbow" joint="elbow" gainprm="40" biastype="affine" biasprm="0 -20 0"/>'
)


@pytest.mark.parametrize("actuator", [INTEGRATING, OTHER_GAIN])
def test_joints_are_displaced_by_servos_of_positions_only(actuator):
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><body><joint name="elbow"/><geom size=".1"/></body></worldbody>
        <actuator>{actuator}</actuator></mujoco>"""
    )
    with pytest.raises(InputError, match="elbow is no servo of positions"):
        JointActions(model)


def test_a_weld_that_is_off_holds_nothing():
    weld = '<weld body1="tip" body2="one" active="{}"/><weld body1="tip" body2="two"/>'
    bodies = "".join(
        f'<body name="{name}"><freejoint/><geom size=".1"/></body>' for name in ("one", "two")
    )
    for active, held in (("true", "one"), ("false", "two")):
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><worldbody><body name="tip" mocap="true"/>{bodies}</worldbody>
            <equality>{weld.format(active)}</equality></mujoco>"""
        )
        assert model.body(find_held(model, "tip").body).name == held
