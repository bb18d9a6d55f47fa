"""Walk the built-in humanoid up the stairs and read its feet."""

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion

scene = footik.Scene.build(builtin_motion("walk"), "stairs", body=HUMANOID)
walker = footik.HumanoidFootIK(scene)
for _ in range(240):
    walker.step(1 / 60)
for foot in walker.feet:
    print(foot, foot.goal_w.round(3))
