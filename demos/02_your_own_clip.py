"""Walk a motion file of your own over hills: python demos/02_your_own_clip.py your.bvh.

Without a path, the built-in walk is written as BVH first, and read back like any other file.
"""

import sys
import tempfile
from pathlib import Path

import footik_runtime as footik
from footik_runtime.builtin import GAITS, humanoid_rig


def write_a_walk(folder: Path) -> Path:
    """A BVH file of the built-in walk. BVH holds no curves: contacts are found in the motion."""
    path = folder / "walk.bvh"
    footik.write_bvh(GAITS["walk"](humanoid_rig(), None), path)
    return path


def walk(path: Path) -> None:
    """Load, find the legs, find the contacts, walk; a body of capsules is made for the clip."""
    clip = footik.load_clip(path)
    rig = footik.find_rig(clip.skeleton)
    motion = footik.Motion.prepare(clip, rig)
    print(f"{path.name}: {len(clip)} frames, a cycle of {motion.clip.duration:.2f} s")
    print(f"speed {motion.speed:.2f} m/s")
    print(rig.describe())
    walker = footik.HumanoidFootIK(footik.Scene.build(motion, "hills"))
    for frame in range(180):
        walker.step(1 / 60)
        if frame % 60 == 59:
            print(f"{walker.time:.0f} s:", "; ".join(str(foot) for foot in walker.feet))


if len(sys.argv) > 1:
    walk(Path(sys.argv[1]))
else:
    with tempfile.TemporaryDirectory() as folder:
        walk(write_a_walk(Path(folder)))
