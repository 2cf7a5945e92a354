"""Playground's cartpole, each environment in one of the worlds of WORLDS.npz, for a few steps."""

import functools
import sys

import jax
import numpy as np
from drawn import check_drawn
from mujoco_playground import registry, wrapper
from playground_worlds import domain_randomizer

NUM_ENVS = 16

env = registry.load("CartpoleBalance", config_overrides={"impl": "jax"})
keys = jax.random.split(jax.random.PRNGKey(0), NUM_ENVS)
randomize = functools.partial(domain_randomizer(env.mj_model), rng=keys)
envs = wrapper.wrap_for_brax_training(env, episode_length=100, randomization_fn=randomize)
state, step = jax.jit(envs.reset)(keys), jax.jit(envs.step)
for _ in range(10):
    state = step(state, jax.numpy.zeros((NUM_ENVS, env.action_size)))
assert np.isfinite(state.obs).all()

model, in_axes = randomize(env.mjx_model)
mass = np.asarray(model.body_mass[:, env.mj_model.body("pole_1").id])
gain = np.asarray(model.actuator_gainprm[:, env.mj_model.actuator("slide").id, 0])
assert in_axes.body_mass == 0
check_drawn(sys.argv[1], pole_mass=mass, actuator_gain=gain)
