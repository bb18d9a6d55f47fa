"""Take footskate out of a clip, and see what it did: python demos/07_clean_a_clip.py your.bvh.

Without a path, a walk is made whose feet slide by 3 cm while they stand.
"""

import sys
import tempfile
from pathlib import Path

import footik_runtime as footik
from footik_runtime.builtin import humanoid_rig
from footik_runtime.gait import walk
from footik_runtime.offline.measure_clip import compare
from footik_runtime.offline.report import report_page
from footik_runtime.offline.skate import inject, true_walk


def a_sliding_walk() -> footik.Clip:
    """A walk whose feet slide by 3 cm in every contact."""
    rig = humanoid_rig()
    return inject(true_walk(walk(rig), rig), "constant", 0.03)


clip = footik.load_clip(sys.argv[1]) if len(sys.argv) > 1 else a_sliding_walk()
cleaned = footik.clean(clip)
table = compare(clip, cleaned)
before, after = (table[name]["pinned_point_speed"] for name in ("before", "after"))
print(f"{clip.name}: {len(cleaned.plants)} plants")
print(f"pinned points slid at {before:.1f} mm/s, now at {after:.2f}")
for note in cleaned.report["notes"]:
    print("note:", note)

baked = footik.bake(cleaned.clip, cleaned.held, cleaned.rig)
keys = baked.extras["curve_keys"]
print("curves:", ", ".join(f"{name} ({len(keys[name].times)} keys)" for name in keys))

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "walk.bvh"
    footik.save_clip(baked, path)
    again = footik.load_clip(path)
    print("written and read again:", ", ".join(sorted(again.curves)))
    page = report_page(clip, cleaned, table)
    print(f"a page to look at, {len(page) // 1000} kB")
