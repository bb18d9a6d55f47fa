"""Stand on a platform that travels, turns and tilts: prints ride in its own frame."""

import numpy as np

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion

scene = footik.Scene.build(builtin_motion("walk"), "platform", body=HUMANOID)
walker = footik.HumanoidFootIK(scene)
ridden = 0
for _ in range(480):
    walker.step(1 / 60)
    on = [foot.name for foot in walker.feet if foot.locked and "platform" in (foot.ground or "")]
    ridden += bool(on)
print(f"a foot was locked on the platform in {ridden} of 480 frames")
print("the root is at", np.round(walker.root_w, 2))
