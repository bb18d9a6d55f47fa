"""A robot of hinges for the tests of joint values, and smooth motion for it."""

import mujoco
import numpy as np

from footik_runtime import quat_arrays as qa


def leg(side, y):
    """Hip yaw, roll, pitch; knee; ankle pitch and roll: with anchors off the bodies' origins."""
    return f"""
    <body name="{side}_thigh" pos="0 {y} -.05">
      <joint name="{side}_hip_yaw" axis="0 0 1" range="-1 1"/>
      <joint name="{side}_hip_roll" axis="1 0 0" range="-1 1"/>
      <joint name="{side}_hip_pitch" axis="0 1 0" range="-2 2" ref=".1"/>
      <geom size=".05 .1" type="capsule" pos="0 0 -.15"/>
      <body name="{side}_shin" pos="0 0 -.4" quat="1 .02 .01 0">
        <joint name="{side}_knee" axis="0 1 0" pos="0 0 .02" range="-.1 2.6"/>
        <geom size=".04 .1" type="capsule" pos="0 0 -.15"/>
        <body name="{side}_foot" pos=".01 0 -.38">
          <joint name="{side}_ankle_pitch" axis="0 1 0" pos="0 0 .03" range="-1 1"/>
          <joint name="{side}_ankle_roll" axis="1 0 0" range="-.6 .6"/>
          <geom size=".1 .04 .02" type="box" pos=".04 0 -.04"/>
        </body>
      </body>
    </body>"""


SLIDES = """
  <joint name="root_x" type="slide" axis="1 0 0"/><joint name="root_y" type="slide" axis="0 1 0"/>
  <joint name="root_z" type="slide" axis="0 0 1"/><joint name="root_yaw" axis="0 0 1"/>
  <joint name="root_roll" axis="1 0 0"/><joint name="root_pitch" axis="0 1 0"/>"""


def robot(root='<freejoint name="root"/>', spine='<joint name="spine" type="ball"/>'):
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco><compiler angle="radian" autolimits="true"/><worldbody>
      <body name="pelvis" pos="0 0 .9">{root}<geom size=".1"/>
        <body name="chest" pos="0 0 .2" quat="1 0 .1 0">{spine}<geom size=".12"/></body>
        {leg("left", 0.1)}{leg("right", -0.1)}
      </body></worldbody></mujoco>""")


def trajectory(model, frames=50, seed=0):
    """Smooth rows of qpos (T, nq) within the limits, legs bent."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None] / 30.0
    wave = np.sin(t * rng.uniform(1, 3, model.nq) + rng.uniform(0, 6, model.nq))
    qpos = model.qpos0 + 0.15 * wave
    for j in range(model.njnt):
        at = model.jnt_qposadr[j]
        if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE:
            turn = qa.euler(0.3 + 0.4 * wave[:, 3], 0.1 * wave[:, 4], 0.1 * wave[:, 5])
            qpos[:, at + 3 : at + 7] = turn
        elif model.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL:
            qpos[:, at : at + 4] = qa.from_rotvec(0.3 * wave[:, at : at + 3])
        elif "knee" in model.joint(j).name:
            qpos[:, at] += 0.5
    return qpos


def save(path, **arrays):
    np.savez(path, **arrays)
    return path


def same_turns(a, b, tolerance):
    return (1.0 - np.abs(np.sum(a * b, axis=-1))).max() < tolerance
