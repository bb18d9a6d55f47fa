"""Read feet while walking along a path: when each lands, on what, what is held, when it leaves."""

import numpy as np

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion

PATH = np.array([(0.0, 0.0), (3.0, 0.0), (5.0, 1.5)])  # points on the ground, m

scene = footik.Scene.build(builtin_motion("walk"), "course", body=HUMANOID)
walker = footik.HumanoidFootIK(scene)
last: dict[str, tuple] = {}
plants = 0
while walker.time < 5.0 and walker.follow(PATH):
    walker.step(1 / 60)
    for foot in walker.feet:
        now = (foot.state, foot.pinned)
        if now == last.get(foot.name):
            continue
        old = last.get(foot.name, ("released", None))
        last[foot.name] = now
        if foot.print_w is None:
            print(f"{walker.time:5.2f} s  {foot.name:5}  released")
        elif foot.pinned and old[1] is None:
            plants += 1
            x, y, z = foot.print_w
            print(
                f"{walker.time:5.2f} s  {foot.name:5}  stands on {foot.ground} at "
                f"({x:.2f}, {y:.2f}, {z:.2f}), {foot.pinned} held"
            )
        elif foot.pinned:
            print(f"{walker.time:5.2f} s  {foot.name:5}  changes to its {foot.pinned}")
print(f"{plants} plants, hips lowered by {100 * walker.hip_drop:.1f} cm at the end")
