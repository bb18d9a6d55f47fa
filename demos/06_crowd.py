"""A crowd: many characters that share a motion, settings and a ground, stepped in one call.

Bodies and feet are NumPy structured arrays, one row a character: read and command them at once.
Nothing here is drawn; `crowd.roots` and `crowd.rotations` are the poses.
"""

import time

import numpy as np

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.feet.record import GROUNDED

COUNT, FRAMES = 500, 60

motion = builtin_motion("walk")
scene = footik.Scene.build(motion, "hills", body=HUMANOID)
crowd = footik.Crowd(motion, scene.ground(), COUNT, threads=2)

rng = np.random.default_rng(1)
places = np.zeros((COUNT, 3))
places[:, 0], places[:, 1] = rng.uniform(3.0, 20.0, COUNT), rng.uniform(-1.0, 1.0, COUNT)
places[:, 2] = scene.ground().height(places, above=5.0, reach=10.0)
crowd.place(places)
speeds = rng.uniform(0.8, 1.6, COUNT)
crowd.command(np.stack([speeds, np.zeros(COUNT)], axis=1))
crowd.bodies["time"] = rng.uniform(0.0, motion.clip.duration, COUNT)  # out of step

crowd.step(1 / 60)  # compiles
began = time.perf_counter()
for _ in range(FRAMES):
    crowd.step(1 / 60)
spent = time.perf_counter() - began

grounded = crowd.feet["state"] == GROUNDED
print(f"{COUNT} characters, {FRAMES} frames: {1e6 * spent / (COUNT * FRAMES):.1f} us each a frame")
print(f"{np.count_nonzero(grounded)} of {grounded.size} feet on the ground")
print(f"{np.count_nonzero(crowd.feet['locked'])} of them locked")
print(f"mean hip drop {100 * crowd.bodies['hip_drop'].mean():.1f} cm")
