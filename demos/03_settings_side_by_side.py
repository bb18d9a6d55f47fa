"""Two presets on the same stairs, and the table of measures that compares them.

The first column is the clip without foot IK, on the same path: what the others are held against.
"""

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion

SECONDS = 5.0
COLUMNS = {
    "without IK": None,
    "default": footik.FootIKSettings(),
    "openkcc": footik.FootIKSettings.openkcc(),
    "no hip drop": footik.FootIKSettings(max_hip_drop=0.0),
}

motion = builtin_motion("walk")
runs = {}
for name, settings in COLUMNS.items():
    scene = footik.Scene.build(motion, "stairs", body=HUMANOID)
    recording = footik.record_walk(
        scene, seconds=SECONDS, settings=settings, ik=settings is not None
    )
    runs[name] = recording.run

ground = footik.Scene.build(motion, "stairs", body=HUMANOID).ground()
table = {
    name: footik.score(
        run, runs["without IK"], ground_height=lambda points, _: ground.height(points)
    )
    for name, run in runs.items()
}
print(footik.format_table(table))
