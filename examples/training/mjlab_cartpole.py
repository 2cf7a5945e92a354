"""mjlab's cartpole, each environment in one of the worlds of WORLDS.npz, for a few steps."""

import sys

import mjlab.tasks  # noqa: F401  (registers them)
import torch
from drawn import check_drawn
from mjlab.envs import ManagerBasedRlEnv
from mjlab.tasks.registry import load_env_cfg
from mjlab_worlds import tuned_worlds

NUM_ENVS = 16

cfg = load_env_cfg("Mjlab-Cartpole-Balance")
cfg.scene.num_envs = NUM_ENVS
cfg.events["tuned_worlds"] = tuned_worlds(prefix="cartpole/")
env = ManagerBasedRlEnv(cfg, device="cpu")
env.reset()
for _ in range(10):
    env.step(torch.zeros(NUM_ENVS, 1))

model, names = env.sim.model, env.sim.mj_model
mass = model.body_mass[:, names.body("cartpole/pole_1").id].cpu().numpy()
gain = model.actuator_gainprm[:, names.actuator("cartpole/slide").id, 0].cpu().numpy()
check_drawn(sys.argv[1], pole_mass=mass, actuator_gain=gain)
