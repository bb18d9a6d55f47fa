"""A small quadruped of hinges whose feet are balls, and a trot for it, in joint values."""

import numpy as np

UPPER = LOWER = 0.2
HIPS = {"FL": (0.2, 0.05), "FR": (0.2, -0.05), "RL": (-0.2, 0.05), "RR": (-0.2, -0.05)}
FPS, PERIOD, STANCE = 100.0, 0.6, 0.55  # frames a second; s; share of it
HEIGHT, STRIDE, LIFT = 0.3, 0.12, 0.06  # m; of the hips over the feet's middles, a stance, a swing


def leg(name, x, y):
    side = 0.08 if y > 0 else -0.08
    return f"""
    <body name="{name}_hip" pos="{x} {y} 0">
      <joint name="{name}_hip_joint" axis="1 0 0" range="-.86 .86"/>
      <geom type="capsule" size=".03" fromto="0 0 0 0 {side} 0"/>
      <body name="{name}_thigh" pos="0 {side} 0">
        <joint name="{name}_thigh_joint" axis="0 1 0" range="-.7 4.5"/>
        <geom type="capsule" size=".015" fromto="0 0 0 0 0 -{UPPER}"/>
        <body name="{name}_calf" pos="0 0 -{UPPER}">
          <joint name="{name}_calf_joint" axis="0 1 0" range="-2.8 -.8"/>
          <geom type="capsule" size=".01" fromto="0 0 0 0 0 -{LOWER - 0.04}"/>
          <geom name="{name}_foot" size=".02" pos="0 0 -{LOWER}"/>
        </body>
      </body>
    </body>"""


def quadruped_xml():
    legs = "".join(leg(name, x, y) for name, (x, y) in HIPS.items())
    return f"""
    <mujoco><compiler angle="radian" autolimits="true"/><worldbody>
      <body name="trunk" pos="0 0 .4"><freejoint name="root"/>
        <geom type="box" size=".2 .08 .05"/>{legs}
      </body></worldbody></mujoco>"""


def trot(model, cycles=3):
    """Rows of qpos (T, nq): straight ahead, opposite legs together."""
    times = np.arange(round(cycles * PERIOD * FPS) + 1) / FPS
    qpos = np.tile(model.qpos0, (len(times), 1))
    qpos[:, 0] = STRIDE / (STANCE * PERIOD) * times
    qpos[:, 2] = HEIGHT + 0.02
    for name in HIPS:
        phase = (times / PERIOD + (0.0 if name in ("FL", "RR") else 0.5)) % 1.0
        x, z = np.vectorize(_foot)(phase)
        reach = np.hypot(x, z)
        bend = np.arccos(np.clip(1.0 - reach**2 / (2.0 * UPPER**2), -1.0, 1.0)) - np.pi
        thigh = np.arctan2(-x, -z) - 0.5 * bend
        for part, value in (("thigh", thigh), ("calf", bend)):
            qpos[:, model.jnt_qposadr[model.joint(f"{name}_{part}_joint").id]] = value
    return qpos


def _foot(phase):
    """Where the foot is under its hip, (x, z), at a phase of its cycle: 0 to STANCE it stands."""
    if phase <= STANCE:
        return STRIDE * (0.5 - phase / STANCE), -HEIGHT
    v = (phase - STANCE) / (1.0 - STANCE)
    smooth = v * v * (3.0 - 2.0 * v)
    return STRIDE * (smooth - 0.5), -HEIGHT + LIFT * np.sin(np.pi * v) ** 2
