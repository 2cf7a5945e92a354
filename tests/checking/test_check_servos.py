"""How joints follow their commands: by hand, and on servos whose answer is known."""

import numpy as np
import pytest

from simtune.checking.doubt import grouped
from simtune.checking.servos.doubts import doubts
from simtune.checking.servos.fit import ServoResponse, delayed_by, filtered_by, fit_servo
from simtune.checking.servos.following import Following, Watched, follows
from simtune.checking.servos.gains import gains_to_write
from simtune.checking.servos.look import look_at, look_at_all
from simtune.checking.servos.lost import missing, without_lost_packets
from simtune.checking.servos.play import find_play, through_play
from simtune.checking.servos.roughness import roughness
from simtune.checking.servos.table import servo_lines
from simtune.fit.readings.readings import filled
from simtune.observation import JointSensor

STEP_S = 0.02


def commands(num: int = 3, steps: int = 400, size: float = 0.5, seed: int = 0) -> list[np.ndarray]:
    """Smooth ones, that rest at first."""
    rng, times = np.random.default_rng(seed), np.arange(steps) * STEP_S
    made = []
    for _ in range(num):
        phase, ramp = rng.uniform(0, 6, 3), np.minimum(1, times / 2)
        waves = sum(np.sin(w * times + p) for w, p in zip((1.1, 2.3, 4.7), phase, strict=True))
        made.append(size * ramp * waves)
    return made


def reads(command: np.ndarray, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    """(T + 1,) readings of what follows (T,) with noise."""
    rng = np.random.default_rng(seed)
    return np.append(command, command[-1]) + noise * rng.normal(size=len(command) + 1)


def said_of(asked: list[np.ndarray], read: list[np.ndarray], unit: str = "rad") -> list[str]:
    joint, servo = Watched("elbow", unit, asked, read, STEP_S), fit_servo(asked, read, STEP_S)
    return grouped(doubts(joint, servo, follows(joint, servo)))


def encoder(name: str, joints: tuple[str, ...], factor: tuple[float, ...]) -> JointSensor:
    num = len(joints)
    return JointSensor(
        name=name,
        columns=("state",),
        joints=joints,
        places=np.arange(num),
        factor=np.array(factor),
        shift=np.zeros(num),
    )


# --- numbers ------------------------------------------------------------------------------


def test_a_command_is_read_between_two_steps():
    command = np.array([1.0, 1.0, 3.0, 7.0])
    np.testing.assert_allclose(delayed_by(command, 1), [1, 1, 1, 3])
    np.testing.assert_allclose(delayed_by(command, 0.25), [1, 1, 2.5, 6])


def test_a_filtered_ramp_is_late_by_the_time_constant_in_the_end():
    ramp = np.arange(100.0)
    late = ramp - filtered_by(ramp, 5.0)
    expected = 5 * (1 - np.exp(-ramp / 5))  # from rest, solved by hand
    np.testing.assert_allclose(late, expected, atol=1e-12)
    np.testing.assert_array_equal(filtered_by(ramp, 0), ramp)


def test_how_rough_readings_are_tells_their_noise_while_a_joint_moves():
    rng = np.random.default_rng(0)
    quick = [np.sin(0.4 * np.arange(400) + phase) for phase in (0, 1, 2)]
    read = [values + 1e-3 * rng.normal(size=400) for values in quick]
    assert roughness(read) == pytest.approx(1e-3, rel=0.3)
    ramp = 0.1 * np.arange(20_000) + 0.02 * rng.normal(size=20_000)
    assert roughness([ramp]) == pytest.approx(0.02, rel=0.05)
    resting = [np.where(np.arange(400) < 300, 0.0, 2e-3 * (np.arange(400) % 3))]
    assert roughness(resting) == pytest.approx(2e-3 / np.sqrt(12)), "no finer than its steps"
    assert np.isnan(roughness([np.full(9, 0.5)]))
    assert np.isnan(roughness([np.full(9, np.nan)]))


ROWS = np.arange(1200)


@pytest.mark.parametrize(
    "spread",
    [
        lambda read: np.where(ROWS % 2, np.nan, read),
        lambda read: np.where(ROWS % 4, np.nan, read),
        lambda read: np.where(ROWS % 7 < 2, np.nan, read),
        lambda read: read[ROWS // 2 * 2],
        lambda read: read[ROWS // 4 * 4],
        lambda read: np.interp(ROWS, ROWS[::2], read[::2]),
        lambda read: np.interp(ROWS, ROWS[::3], read[::3]),
        lambda read: np.interp(ROWS, ROWS[::4], read[::4]),
        lambda read: np.interp(ROWS / 1.2, ROWS, read),  # 25 Hz at 30 Hz
        lambda read: np.interp(ROWS / 1.7, ROWS, read),
        lambda read: np.interp(ROWS / 2.4, ROWS, read),
    ],
    ids=[
        "empty2",
        "empty4",
        "lost",
        "held2",
        "held4",
        "straight2",
        "straight3",
        "straight4",
        "rate1.2",
        "rate1.7",
        "rate2.4",
    ],
)
@pytest.mark.parametrize(("noise", "step"), [(5e-3, 0.0), (2e-3, 5e-3)])
def test_held_interpolated_and_empty_rows_hide_no_noise(spread, noise, step):
    """Of a joint that swings at .4 Hz, read 50 times a second or less."""
    rng = np.random.default_rng(0)
    moves = [np.sin(0.05 * ROWS + phase) + noise * rng.normal(size=len(ROWS)) for phase in (0, 2)]
    read = [np.round(its / step) * step if step else its for its in moves]
    true = np.hypot(noise, step / np.sqrt(12))
    assert 0.6 * true < roughness([spread(its) for its in read]) < 2 * true


@pytest.mark.parametrize("share", [0.15, 0.4, 0.6])
def test_rows_lost_at_random_are_no_noise(share):
    rng = np.random.default_rng(0)
    read = 0.5 * np.sin(0.1 * np.arange(800)) + 1e-3 * rng.normal(size=800)
    read[rng.random(800) < share] = np.nan
    assert roughness([read]) == pytest.approx(1e-3, rel=0.35)


@pytest.mark.parametrize("held", [2, 3])
@pytest.mark.parametrize("share", [0.05, 0.1])
def test_rows_lost_of_held_readings_are_no_noise(held, share):
    """A held reading is older than its row: beside a lost one the distance was another."""
    rng = np.random.default_rng(1)
    own = 0.5 * np.sin(0.1 * np.arange(0, 1200, held)) + 1e-3 * rng.normal(size=1200 // held)
    read = np.repeat(own, held)
    read[rng.random(1200) < share] = np.nan
    assert 0.7e-3 < roughness([read]) < 1.8e-3


@pytest.mark.parametrize(("per_row", "noise"), [(0.25, 1e-3), (0.42, 1e-2)])
def test_motion_that_only_the_highest_order_tells_from_noise_is_none(per_row, noise):
    """Every other row would show motion, less in each higher order: it was two or three times."""
    rng, angle = np.random.default_rng(0), per_row * np.arange(500)
    waves = 0.5 * np.sin(angle) + 0.2 * np.sin(1.7 * angle + 1)
    read = waves + noise * rng.normal(size=500)
    assert roughness([read]) == pytest.approx(noise, rel=0.25)


def test_jerks_of_a_servo_are_no_noise():
    """Steps every half second, read 50 times a second: what moves every fourth row is rough."""
    rng = np.random.default_rng(0)
    asked = [np.repeat(rng.uniform(-0.8, 0.8, 40), 25) for _ in range(2)]
    read = [filtered_by(filtered_by(c, 3.0), 2.0) + 2e-3 * rng.normal(size=1000) for c in asked]
    assert 1.8e-3 < roughness(read) < 4e-3


@pytest.mark.parametrize("lag", [0.0, 1.0, 3.4, 11.7])
def test_delay_and_offset_of_a_servo_that_only_is_late(lag):
    asked = commands()
    read = [reads(delayed_by(c, lag)) + 0.03 for c in asked]
    read[1][50:60] = np.nan
    servo = fit_servo(asked, read, STEP_S)
    assert servo.lag_steps == pytest.approx(lag, abs=0.05)
    assert servo.lag_s == pytest.approx(lag * STEP_S, abs=0.001)
    assert servo.offset == pytest.approx(0.03, abs=1e-3)
    assert servo.rms < 1e-3
    assert servo.filtered_rms <= servo.rms + 1e-3
    assert servo.commanded == pytest.approx(servo.travel, rel=0.01)
    assert said_of(asked, read) == []


def test_a_first_order_lag_is_told_from_a_delay():
    asked = commands()
    read = [reads(delayed_by(filtered_by(c, 6.0), 2.5), 0.001) - 0.01 for c in asked]
    servo = fit_servo(asked, read, STEP_S)
    assert servo.time_constant_s == pytest.approx(0.12, rel=0.1)
    assert servo.filtered_lag_s == pytest.approx(0.05, abs=0.01)
    assert servo.filtered_offset == pytest.approx(-0.01, abs=1e-3)
    assert servo.filtered_rms == pytest.approx(0.001, rel=0.2)
    assert servo.rms > 10 * servo.filtered_rms
    assert servo.noise == pytest.approx(0.001, rel=0.2)  # and not what it moves
    assert said_of(asked, read) == []


def test_nothing_is_told_of_a_command_that_never_changes():
    still = [np.full(100, 0.3)]
    read = [reads(still[0], 0.01)]
    servo = fit_servo(still, read, STEP_S)
    assert np.isnan([servo.lag_s, servo.offset, servo.filtered_rms]).all()
    assert servo.noise == pytest.approx(0.01, rel=0.4)
    assert said_of(still, read) == []
    nothing = [np.full(101, np.nan)]
    assert isinstance(fit_servo(commands(1, 100), nothing, STEP_S), ServoResponse)
    assert said_of(commands(1, 100), nothing) == []


@pytest.mark.parametrize("width", [0.01, 0.03])
@pytest.mark.parametrize("follow", [lambda c: delayed_by(filtered_by(c, 4), 2), lambda c: c])
def test_a_play_is_told_from_a_lag(width, follow):
    asked = commands()
    for its, is_there in ((0.0, False), (width, True)):
        read = [reads(through_play(follow(c), its), 0.001) for c in asked]
        servo = fit_servo(asked, read, STEP_S)
        play = find_play(servo, asked, read, STEP_S)
        assert play.is_clear(servo.noise) == is_there
        assert play.width == pytest.approx(its, rel=0.2, abs=2e-3)


def test_what_is_behind_a_play_rests_until_the_motor_has_crossed_it():
    moved = through_play(np.array([0.0, 1, 3, 2, 1, 0]), 2.0)
    assert moved.tolist() == [0, 0, 2, 2, 2, 1]


@pytest.mark.parametrize("spoil", [lambda y: 0.85 * y - 0.1, lambda y: np.minimum(y, 0.5)])
def test_a_soft_servo_and_a_stop_are_no_play(spoil):
    asked = commands()
    read = [reads(spoil(delayed_by(filtered_by(c, 4), 2)), 0.001) for c in asked]
    servo = fit_servo(asked, read, STEP_S)
    assert not find_play(servo, asked, read, STEP_S).is_clear(servo.noise)


def test_a_table_says_which_joints_stay_behind():
    servo = dict.fromkeys(ServoResponse.__annotations__, 0.1)
    servos = {n: servo | {"unit": "rad", "play": w} for n, w in (("elbow", 0.03), ("wrist", None))}
    said = servo_lines(servos)
    assert "Behind to both sides, from end to end: elbow by 0.03 rad." in said
    head, legend = said[0], " ".join(said[3:])
    for column in ("lag", "offset", "left", "noise"):
        assert f"  {column}" in head
        assert f"{column}: " in legend
    assert "noise: how rough readings are, at most" in legend
    assert not any("Behind" in line for line in servo_lines({"wrist": servos["wrist"]}))


# --- what no model explains -----------------------------------------------------------------


def test_a_joint_that_does_not_move():
    asked = commands()
    (said,) = said_of(asked, [reads(np.full(400, 0.2), 0.001, i) for i in range(3)])
    assert said.startswith("elbow does not move, though commanded over 2")


def test_a_reading_that_stands_still_all_the_time():
    (said,) = said_of(commands(), [np.full(401, 0.25)] * 3)
    assert said.startswith("elbow reads 0.25 rad all the time, while it is commanded over")


def test_a_reading_that_gets_stuck_for_a_while():
    asked = commands()
    read = [reads(delayed_by(c, 3), 1e-3) for c in asked]
    read[2][200:260] = 0.125
    (said,) = said_of(asked, read)
    assert "reads 0.125 rad for 1.2 s of episode 2, counted from 0, while it is commanded" in said


def test_a_joint_that_rests_when_it_is_asked_to_is_not_stuck():
    asked = commands()
    for command in asked:
        command[100:200] = command[100]
    assert said_of(asked, [reads(delayed_by(c, 3)) for c in asked]) == []


@pytest.mark.parametrize(
    ("factor", "unit", "said"),
    [
        (180 / np.pi, "rad", 'are its readings degrees? give the sensor unit = "deg"'),
        (np.pi / 180, "rad", "are its readings rad already, or are the actions degrees?"),
        (1000, "m", 'are its readings mm? give the sensor unit = "mm"'),
        (-1, "rad", "the sign of its readings, or of its actions, is reversed"),
        (-180 / np.pi, "rad", "the sign is reversed, too"),
    ],
)
def test_other_units_and_signs(factor, unit, said):
    asked = commands()
    read = [factor * reads(delayed_by(filtered_by(c, 4), 2), 0.01) + 0.2 for c in asked]
    (found,) = said_of(asked, read, unit)
    assert said in found
    assert found.startswith("elbow moves ")


@pytest.mark.parametrize("lag", [0.3, 0.8, 1.3])
def test_half_a_period_of_a_sine_is_no_reversed_sign(lag):
    asked = [0.5 * np.sin(2 * np.pi * np.arange(600) / 10)]
    read = reads(delayed_by(asked[0], lag), 0.001)
    assert said_of(asked, [read]) == []
    (said,) = said_of(asked, [-read])
    assert "moves -1 times as far" in said


@pytest.mark.parametrize(
    ("factor", "said"),
    [(-1, "is reversed"), (180 / np.pi, "readings degrees?"), (np.pi / 180, "rad already")],
)
def test_other_units_and_signs_of_an_arm_that_strikes_things(factor, said):
    """It is held up half of the time, and follows with a correlation of 0.66."""
    asked, rng = commands(), np.random.default_rng(3)
    pushed = [np.repeat(rng.normal(size=40), 10) * 0.45 for _ in asked]
    read = [
        reads(factor * (0.75 * delayed_by(c, 3) + p)) for c, p in zip(asked, pushed, strict=True)
    ]
    (found,) = said_of(asked, read)
    assert said in found
    assert found.startswith("elbow moves ")


def test_another_joint_s_column():
    (said,) = said_of(commands(), [reads(c) for c in commands(seed=7)])
    assert "hardly follows its command" in said


def test_where_no_other_column_follows_better_none_is_asked_for():
    (said,) = said_of(commands(), [reads(c) for c in commands(seed=7)])
    assert "no other joint's column does so better. Is its servo weak" in said


def test_of_joints_that_move_together_the_pair_that_explains_both_is_told():
    """Hip 3 steps with hip 1, and follows its own command: it is not the ankle's column."""
    hip, ankle = commands(), commands(seed=7)
    other = [its + 0.1 * more for its, more in zip(hip, commands(seed=9), strict=True)]
    asked = {"hip_1": hip, "ankle_1": ankle, "hip_3": other}
    read = {"hip_1": ankle, "ankle_1": other, "hip_3": other}  # a bit nearer to the third's
    joints = [
        Watched(name, "rad", asked[name], [reads(c) for c in read[name]], STEP_S) for name in asked
    ]
    doubts = [
        its.doubts for its in look_at_all(joints, [encoder("legs", tuple(asked), (1.0, 1.0, 1.0))])
    ]
    (said,) = grouped(doubts[1])
    assert said.startswith("ankle_1 follows hip_1's command")
    assert doubts[2] == []


@pytest.mark.parametrize("scale", [np.pi / 180, 180 / np.pi])
def test_a_unit_that_all_joints_share_is_told_alone(scale):
    asked = {name: commands(seed=seed) for name, seed in (("hip", 1), ("knee", 2), ("ankle", 3))}
    weak = {"hip": 1.0, "knee": 0.6, "ankle": 0.3}

    def read(name: str, command: np.ndarray) -> np.ndarray:
        return reads(scale * weak[name] * command, 0.02 * (1 - weak[name]) * scale)

    joints = [
        Watched(name, "rad", its, [read(name, command) for command in its], STEP_S)
        for name, its in asked.items()
    ]
    legs = encoder("legs", tuple(asked), (1.0, 1.0, 1.0))
    seen = look_at_all(joints, [legs])
    (said,) = grouped(doubt for its in seen for doubt in its.doubts)
    assert ('unit = "deg"' if scale > 1 else "rad already, or are the actions degrees") in said
    assert said.endswith("(likewise knee, ankle)")
    assert gains_to_write([legs], [its.misread_by for its in seen]) == []


@pytest.mark.parametrize("factor", [1, -1000])
def test_columns_that_are_exchanged_are_told_by_whose_command_is_followed(factor):
    asked = {"elbow": commands(), "wrist": commands(seed=7), "thumb": commands(seed=9)}
    read = {"elbow": "wrist", "wrist": "elbow", "thumb": "thumb"}
    joints = [
        Watched(name, "m", asked[name], [factor * reads(c) for c in asked[read[name]]], STEP_S)
        for name in asked
    ]
    seen = [look_at(joint, joints) for joint in joints]
    for its, (name, other) in zip(seen, [("elbow", "wrist"), ("wrist", "elbow")], strict=False):
        (said,) = grouped(its.doubts)
        assert said.startswith(f"{name} follows {other}'s command, its own with a correlation of ")
        assert said.endswith(": are columns exchanged?")
        assert its.misread_by is None  # nothing is known of its own column
    assert not any("exchanged" in said for said in grouped(seen[2].doubts))
    said, *_ = grouped(doubt for its in seen for doubt in its.doubts)  # a reversed thumb's last
    assert said.endswith(": are columns exchanged? (likewise wrist elbow's)")


def test_exchanged_columns_of_joints_that_move_against_each_other_are_no_reversed_sign():
    """A gripper's two sides, or a squatting leg's hip and knee: either looks like both."""
    elbow = commands()
    wrist = [0.25 * other - its for its, other in zip(elbow, commands(seed=7), strict=True)]
    asked, read = {"elbow": elbow, "wrist": wrist}, {"elbow": wrist, "wrist": elbow}
    joints = [
        Watched(name, "rad", asked[name], [reads(c) for c in read[name]], STEP_S) for name in asked
    ]
    for joint in joints:
        assert follows(joint, look_at(joint).servo).correlation < -0.9
        (said,) = grouped((seen := look_at(joint, joints)).doubts)
        assert said.endswith(": are columns exchanged?")
        assert seen.misread_by is None
    own = [joint._replace(measured=[-reads(c) for c in joint.commands]) for joint in joints]
    for joint in own:
        (said,) = grouped((seen := look_at(joint, own)).doubts)
        assert said.endswith("the sign of its readings, or of its actions, is reversed")
        assert seen.misread_by == -1


@pytest.mark.parametrize("sign", [1, -1])
def test_velocities_are_told_where_positions_are_declared(sign):
    """Not as a reversed sign or another joint's column, either of which they look like."""
    asked, late = commands(), [filtered_by(command, 4) for command in commands()]
    read = [sign * reads(np.gradient(its, STEP_S), noise=0.02) for its in late]
    seen = look_at(joint := Watched("elbow", "rad", asked, read, STEP_S), [joint])
    (said,) = grouped(seen.doubts)
    assert said.startswith("elbow reads that whose integral follows its command (correlation ")
    assert said.endswith('are these velocities? give the sensor quantity = "velocity"')
    assert seen.misread_by is None  # no sign to mend


def test_joints_with_the_same_doubt_share_a_sentence():
    asked = commands()
    read = {"hip": [57.3 * reads(c) for c in asked], "knee": [0.2 + 0 * reads(c) for c in asked]}
    read |= {name: [factor * reads(c) for c in asked] for name, factor in (("a", 57), ("b", 58))}
    joints = [Watched(name, "rad", asked, its, STEP_S) for name, its in read.items()]
    first, second = grouped(d for joint in joints for d in look_at(joint).doubts)
    assert first.startswith("hip moves 57.3 times as far as its command: are its readings degrees?")
    assert first.endswith("(likewise a, b)")
    assert second.startswith("knee reads 0.2 rad all the time")


@pytest.mark.parametrize(
    ("factors", "sensor", "line"),
    [
        ((1000, -1000), (1.0, 1.0), "gain = [0.001, -0.001] for sensor pusher"),
        ((1, -1), (1000.0, 1000.0), "gain = [0.001, -0.001] for sensor pusher"),  # unit = "mm"
        ((-1, -1), (1.0, 1.0), "gain = -1 for sensor pusher"),
        ((-1, 1), (0.5, -0.5), "gain = -2 for sensor pusher"),
        ((1000, 1000), (1.0, 1.0), None),  # unit = "mm" says it all
        ((0.001, -0.001), (1.0, 1.0), None),  # or are the actions mm?
        ((-1000, 0), (1.0, 1.0), "gain = [-0.001, 0.001] for sensor pusher"),  # y rests
    ],
)
def test_a_unit_and_a_sign_are_one_line_to_write(factors, sensor, line):
    asked = commands()
    seen = [
        look_at(Watched(name, "m", asked, [f * reads(c) for c in asked], STEP_S))
        for name, f in zip("xy", factors, strict=True)
    ]
    pusher = encoder("pusher", ("x", "y"), sensor)
    said = gains_to_write([pusher], [its.misread_by for its in seen])
    assert [line in its for its in said] == ([True] if line else [])


@pytest.mark.parametrize(
    ("misread_by", "gains"),
    [
        ((-1000.0, 1000.0, None), "[-0.001, 0.001, 0.001]"),
        ((-1000.0, 1.0, None), None),  # which of both the third has is not known
        ((None, None, None), None),
    ],
)
def test_what_no_servo_commands_is_in_the_unit_of_its_sensor(misread_by, gains):
    said = gains_to_write([encoder("arm", ("a", "b", "c"), (1.0, 1.0, 1.0))], misread_by)
    assert [f"write gain = {gains} for sensor arm" in its for its in said] == [True] * bool(gains)


@pytest.mark.filterwarnings("error")
def test_a_single_reading_tells_nothing():
    asked, read = commands(num=1), [np.full(401, np.nan)]
    read[0][7] = 0.2
    joint, servo = Watched("elbow", "rad", asked, read, STEP_S), fit_servo(asked, read, STEP_S)
    assert follows(joint, servo) == Following(0.0, 0.0, 0.0)


def test_a_joint_that_stays_behind_where_it_is_commanded_farthest():
    asked = commands()
    read = [reads(np.minimum(delayed_by(filtered_by(c, 4), 2), 0.5), 0.002) for c in asked]
    (said,) = said_of(asked, read)
    assert "a torque limit, a stop, or something that it holds?" in said
    assert "and follows elsewhere" in said


def test_readings_in_radians_of_a_sensor_declared_in_degrees_hardly_move():
    """Of an arm that is pushed about, so that it hardly follows its command."""
    asked = commands()
    small = [reads(np.deg2rad(c[::-1]), 0.0) for c in asked]
    (said,) = said_of(asked, small)
    assert said.endswith("this its column? Or are these rad, and the sensor says degrees?")
    (said,) = said_of(asked, [read / 20 for read in small])
    assert said.endswith("is it switched on, and this its column?")


def test_a_soft_servo_is_no_doubt():
    """It gives way everywhere alike: a gain and a gravity explain it."""
    asked = commands()
    read = [reads(0.85 * delayed_by(filtered_by(c, 4), 2), 0.002) - 0.1 for c in asked]
    assert said_of(asked, read) == []


# --- readings that are lost ---------------------------------------------------------------


@pytest.mark.parametrize("steps", [40, 400])
def test_a_lost_packet_is_left_out_and_said(steps):
    asked = commands(2, steps)
    read = [reads(command, noise=0.002) for command in asked]
    true = [values.copy() for values in read]
    read[1][[17, 30, 31]] = 655.35, -40.0, -40.0
    if steps == 40:
        read[1][30:32] = true[1][30:32]
    kept, (said,) = without_lost_packets("elbow", "rad", asked, read, 1e-3)
    assert said.startswith("elbow reads 655 rad at step 17 of episode 1, counted from 0, and -")
    assert ("(one of 3 such readings): a lost packet?" in said) == (steps == 400)
    assert np.isnan(kept[1]).sum() == (3 if steps == 400 else 1)
    np.testing.assert_array_equal(kept[0], true[0])
    is_known = np.isfinite(kept[1])
    np.testing.assert_array_equal(kept[1][is_known], true[1][is_known])


def test_a_joint_that_moves_once_has_lost_nothing():
    """A gripper at an episode's end; one that is pressed and rests; a flickering last digit."""
    asked, read = np.zeros(400), np.zeros(401)
    asked[396:], read[397:] = 0.8, 0.8
    pressed, its = np.zeros(400), np.zeros(401)
    pressed[200:203], its[201:204] = 0.8, 0.7
    flickers = np.zeros(401)
    flickers[90] = 0.017
    both_ways, held = np.zeros(1001), np.zeros(1000)
    both_ways[[37, 500]] = 0.0015, -0.0015
    some = (asked, read), (pressed, its), (pressed, flickers), (held, both_ways)
    for command, values in some:
        kept, said = without_lost_packets("grip", "rad", [command], [values], 1e-3)
        assert said == []
        np.testing.assert_array_equal(kept[0], values)


def test_readings_that_are_mostly_missing():
    values = np.zeros((2, 41, 2))
    values[1, 21:] = np.nan  # shorter
    values[0, 10:, 1], values[1, 14:, 0] = np.nan, np.nan
    (said,) = missing(["elbow", "wrist"], values, [40, 20])
    assert said.startswith("76% of the steps of episode 0, counted from 0, lack wrist: was its l")
    (said,) = missing(["elbow", "wrist"], values, [40, 20], ["swing3", "swing4"])
    assert said.startswith("76% of the steps of swing3 lack wrist: ")
    values[0, 12:, 0] = np.nan
    (said,) = missing(["elbow", "wrist"], values, [40, 20], ["swing3", "swing4"])  # in one line
    assert said.startswith("76% of the steps of swing3 lack wrist: ")
    assert said.endswith("is it another column? (likewise elbow)")


def test_an_encoder_that_is_slower_than_the_log_lacks_nothing():
    rng, rows = np.random.default_rng(0), np.arange(0, 400, 5)
    values, slow = np.full((1, 401, 1), np.nan), [400]
    values[0, rows + rng.integers(2, size=len(rows))] = 0.0  # at 20 Hz in 100 Hz, and jitters
    values[0, rows[7] : rows[7] + 2] = np.nan  # one is lost
    assert missing(["yaw"], values, slow) == []
    cut = values.copy()
    cut[0, 150:] = np.nan
    rare, irregular = np.full((2, 1, 401, 1), np.nan)
    rare[0, ::100] = 0.0
    irregular[0, rng.random(401) < 0.2] = 0.0
    for given in (cut, rare, irregular, np.full_like(cut, np.nan)):
        assert len(missing(["yaw"], given, slow)) == 1


def test_missing_readings_are_interpolated_before_actions_displace_them():
    read = np.array([[np.nan, np.nan], [1.0, np.nan], [np.nan, np.nan], [2.0, np.nan]])
    np.testing.assert_allclose(filled(read[None])[0], [[1, 0], [1, 0], [1.5, 0], [2, 0]])
