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
    return mujoco.MjModel.from_xml_string(robot_xml(root, spine))


def robot_xml(root='<freejoint name="root"/>', spine='<joint name="spine" type="ball"/>'):
    return f"""
    <mujoco><compiler angle="radian" autolimits="true"/><worldbody>
      <body name="pelvis" pos="0 0 .9">{root}<geom size=".1"/>
        <body name="chest" pos="0 0 .2" quat="1 0 .1 0">{spine}<geom size=".12"/></body>
        {leg("left", 0.1)}{leg("right", -0.1)}
      </body></worldbody></mujoco>"""


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


PERIOD, STANCE, FPS = 1.0, 0.6, 60.0  # s, share of it, frames a second


def sliding_walk(model, feet, *, slide=0.06, speed=0.4, seconds=3.0, crouch=0.06):
    """Rows of qpos (T, nq), and which foot stands (T, 2): a walk of hinges on soles that slide.

    Each foot (a body's name) is carried by `slide` metres forward, and a third of that outward,
    during each stance; the pelvis goes straight ahead. Angles are found by MuJoCo's own Jacobians
    and stay within the joints' limits.
    """
    times = np.arange(round(seconds * FPS) + 1) / FPS
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies = [model.body(name).id for name in feet]
    rest = data.xpos[bodies].copy()
    standing = np.zeros((len(times), 2), dtype=bool)
    rows, qpos = [], model.qpos0.copy()
    for joint in range(model.njnt):  # off the straight knee, where Jacobians say nothing
        for part, bend in (("hip_pitch", -0.25), ("knee", 0.5), ("ankle_pitch", -0.25)):
            qpos[model.jnt_qposadr[joint]] += bend * (part in model.joint(joint).name)
    for frame, t in enumerate(times):
        qpos[0], qpos[2] = speed * t, model.qpos0[2] - crouch
        goals = rest.copy()
        for foot in range(2):
            cycle, phase = divmod(t / PERIOD + 0.5 * foot, 1.0)
            middle = speed * PERIOD * (cycle - 0.5 * foot + 0.5 * STANCE)
            u = phase / STANCE
            standing[frame, foot] = u <= 1.0
            away = np.array([1.0, (-1.0) ** foot / 3.0, 0.0]) * slide
            if u <= 1.0:
                goals[foot] += [middle, 0.0, 0.0] + away * (u - 0.5)
            else:
                v = (phase - STANCE) / (1.0 - STANCE)
                smooth = v * v * (3.0 - 2.0 * v)
                goals[foot] += [
                    middle + speed * PERIOD * smooth,
                    0.0,
                    0.08 * np.sin(np.pi * v) ** 2,
                ]
                goals[foot] += away * (0.5 - smooth)
        qpos = _posed(model, data, qpos, bodies, goals)
        rows.append(qpos.copy())
    return np.array(rows), standing


def _posed(model, data, qpos, bodies, goals):
    """qpos with the feet level at their goals, as near as the limits of their hinges let them."""
    place, turn = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    for _ in range(12):
        for body, goal in zip(bodies, goals, strict=True):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacBody(model, data, place, turn, body)
            columns = np.flatnonzero(place[:, 6:].any(axis=0) | turn[:, 6:].any(axis=0)) + 6
            error = np.concatenate([goal - data.xpos[body], -qa.to_rotvec(data.xquat[body])])
            jacobian = np.vstack([place, turn])[:, columns]
            step = np.linalg.lstsq(jacobian, error, rcond=1e-4)[0].clip(-0.2, 0.2)
            for column, change in zip(columns, step, strict=True):
                joint = model.dof_jntid[column]
                at, (low, high) = model.jnt_qposadr[joint], model.jnt_range[joint]
                qpos[at] = np.clip(qpos[at] + change, low, high)
    return qpos


def sole_speeds(model, qpos, feet, standing):
    """(N,) m/s of the middles of soles that stand, over the ground, by MuJoCo's kinematics."""
    data = mujoco.MjData(model)
    places = np.empty((len(qpos), 2, 3))
    for frame, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        for foot, name in enumerate(feet):
            body = model.body(name).id
            matrix = data.xmat[body].reshape(3, 3)
            places[frame, foot] = data.xpos[body] + matrix @ [0.03, 0.0, -0.03]
    speeds = np.linalg.norm(np.diff(places[..., :2], axis=0), axis=-1) * FPS
    return speeds[standing[1:] & standing[:-1]]


def beyond_limits(model, qpos):
    """How far, rad, the worst hinge is beyond its limits in rows of qpos."""
    hinges = [j for j in range(model.njnt) if model.jnt_limited[j] and model.jnt_type[j] == 3]
    values = qpos[:, model.jnt_qposadr[hinges]]
    low, high = model.jnt_range[hinges].T
    return float(np.maximum(low - values, values - high).max())
