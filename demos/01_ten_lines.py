"""The whole library in ten lines: a clip, a scene, a controller, and what each foot does."""

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion

motion = builtin_motion("walk")
scene = footik.Scene.build(motion, "stairs", body=HUMANOID)
walker = footik.HumanoidFootIK(scene)
for _ in range(240):
    walker.step(1 / 60)  # writes scene.data.qpos, and a qvel to match
for foot in walker.feet:
    print(foot)
print(f"at x = {walker.root_w[0]:.2f} m, hips lowered by {100 * walker.hip_drop:.1f} cm")
