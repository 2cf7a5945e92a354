"""What estimates owe to the timestep along what readings hardly tell: masses and gains together."""

from pathlib import Path

import mujoco
import numpy as np
from servo_arm import HEAD, MJCF, SHOULDER, write_arm

from simtune.budget import Budget
from simtune.fit import Guess, OutputErrorMethod, Readings, ReplayStage
from simtune.fit.readings import timestep
from simtune.fit.readings.differences import differentiate
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.timestep import change_by_timestep
from simtune.real.observed import observed
from simtune.tasks import load_task

STEPS, STEP_S, NOISE = 100, 0.05, 3e-4
SCENE = MJCF.replace('armature=".01"', 'armature=".001"')
OTHERS = "".join(
    f'[[parameters]]\nname = "{name}"\nkind = "{kind}"\nobjects = "{objects}"\n\n'
    for name, kind, objects in (
        ("elbow_kp", "gain", "elbow"),
        ("elbow_kv", "gain_damping", "elbow"),
        ("upper_mass", "mass", "upper"),
        ("lower_mass", "mass", "lower"),
    )
)


def recorded(num: int) -> Readings:
    """Of an arm that moves with steps of 100 µs, at rest at first."""
    model = mujoco.MjModel.from_xml_string(SCENE.format(timestep_s=1e-4))
    data, rng, read, sent = mujoco.MjData(model), np.random.default_rng(0), [], []
    for _ in range(num):
        goals = np.repeat(rng.uniform(-0.8, 0.8, (STEPS // 10, 2)), 10, 0)
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = goals[0]
        mujoco.mj_step(model, data, 30_000)
        places = [data.qpos.copy()]
        for data.ctrl[:] in goals:
            mujoco.mj_step(model, data, round(STEP_S / 1e-4))
            places.append(data.qpos.copy())
        read.append(places + NOISE * rng.normal(size=(STEPS + 1, 2)))
        sent.append(goals)
    return Readings(np.array(sent), np.array(read))


def test_the_change_of_all_masses_and_gains_together_is_found_in_a_few_steps(
    tmp_path: Path, monkeypatch
):
    """A descent with more damping crept along what a light rotor tells of them."""
    tune = HEAD.replace("0.002", f"{NOISE}\noffset = 0") + SHOULDER + OTHERS
    write_arm(tmp_path, tune)
    (tmp_path / "arm.xml").write_text(SCENE.format(timestep_s=4e-3))
    task = load_task(str(tmp_path / "tune.toml"))
    simulator = task.simulator(image_size=16)
    seen, space = observed(task, None, is_simulated=False), simulator.space
    loop = set_up_loop(simulator, seen, space.nominal)
    method = OutputErrorMethod(loop, np.zeros(2, bool), space.to_unit(space.nominal))
    guess = Guess(method.prior, np.zeros(2))
    ended = method.descend(recorded(3), guess, ReplayStage(20), Budget())
    slopes = differentiate(loop, ended.objective.difference_point(ended.point))
    found = change_by_timestep(ended, slopes, Budget())
    monkeypatch.setattr(timestep, "_ITERATIONS", 100)
    last = change_by_timestep(ended, slopes, Budget())
    assert np.abs(last).max() > 0.03
    np.testing.assert_allclose(found, last, rtol=0.15)
