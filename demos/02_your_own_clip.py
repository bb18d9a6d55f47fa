"""Walk a BVH file over hills: `python demos/02_your_own_clip.py [FILE]`.

Without a file, one is written from the built-in gait first, so that there is something to read.
"""

import sys
import tempfile
from pathlib import Path

import footik_runtime as footik
from footik_runtime.builtin import humanoid_rig
from footik_runtime.gait import walk

with tempfile.TemporaryDirectory() as folder:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder) / "walk.bvh"
    if len(sys.argv) < 2:
        footik.write_bvh(walk(humanoid_rig(), speed=1.1), path)
    clip = footik.load_clip(path)
rig = footik.find_rig(clip.skeleton)
print(rig.describe())
motion = footik.Motion.prepare(clip, rig)
print(f"a cycle of {motion.clip.duration:.2f} s at {motion.speed:.2f} m/s")
scene = footik.Scene.build(motion, "hills")  # a body of capsules is made for the skeleton
recording = footik.record_walk(scene, seconds=4.0)
print(f"feet were held still in {100 * recording.feet['locked'].mean():.0f} % of all frames")
