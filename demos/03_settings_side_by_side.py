"""The same walk up a slope under three settings, measured side by side."""

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion

motion = builtin_motion("walk")
settings = {
    "no IK": None,
    "openkcc": footik.FootIKSettings.openkcc(),
    "default": footik.FootIKSettings(),
}
runs = {}
for name, chosen in settings.items():
    scene = footik.Scene.build(motion, "slope", body=HUMANOID)
    recording = footik.record_walk(scene, seconds=5.0, settings=chosen, ik=chosen is not None)
    runs[name] = recording.run
print(footik.format_table({name: footik.score(run, runs["no IK"]) for name, run in runs.items()}))
