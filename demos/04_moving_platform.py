"""Feet ride what they stand on: a slab that travels, lifts, turns and tilts under a standing body.

A print lives in the frame of its body. In the world it moves; on the slab it does not, as long as
the foot is locked. A foot whose place no longer suits takes a step of its own: a bump stride.
"""

import numpy as np

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.terrain import Flat, Platform, Terrain

slab = Platform(length=4.0, travel=(0.0, 0.0), turn_deg=60.0, lift=0.1, period=4.0)
terrain = Terrain(name="turntable", pieces=(Flat(length=5.0), slab))
scene = footik.Scene.build(builtin_motion("idle"), terrain, body=HUMANOID)
body = next(b for b in range(scene.model.nbody) if scene.model.body_mocapid[b] >= 0)
walker = footik.HumanoidFootIK(scene)
walker.place(scene.data.xpos[body])


def on_slab(point_w: np.ndarray) -> np.ndarray:
    """A world point in the frame of the slab."""
    return scene.data.xmat[body].reshape(3, 3).T @ (point_w - scene.data.xpos[body])


moved_w, moved_slab, bumps = 0.0, 0.0, 0
states = [foot.state for foot in walker.feet]
before: dict[str, tuple[np.ndarray, np.ndarray]] = {}
for _ in range(6 * 60):
    walker.step(1 / 60)
    for i, foot in enumerate(walker.feet):
        bumps += foot.state == "bump stride" != states[i]
        states[i] = foot.state
        if not foot.locked or foot.print_w is None:
            before.pop(foot.name, None)
            continue
        here = (foot.print_w, on_slab(foot.print_w))
        if foot.name in before:
            last_w, last_slab = before[foot.name]
            moved_w = max(moved_w, float(np.linalg.norm(here[0] - last_w)))
            moved_slab = max(moved_slab, float(np.linalg.norm(here[1] - last_slab)))
        before[foot.name] = here

print(f"largest way of a locked print in one frame: {1000 * moved_w:.2f} mm in the world")
print(f"                                            {1000 * moved_slab:.2f} mm on the slab")
print(f"bump strides in {walker.time:.0f} s: {bumps}")
for foot in walker.feet:
    print(foot)
