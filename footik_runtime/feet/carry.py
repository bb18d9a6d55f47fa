"""What is carried over: whenever what a foot follows changes, the difference becomes an offset that
decays to exactly zero.
"""

from __future__ import annotations

from footik_runtime.compiled import compiled
from footik_runtime.inertia import decayed, limited_velocity
from footik_runtime.math3d import (
    add,
    get3,
    get4,
    quat_conj,
    quat_from_rotvec,
    quat_mul,
    quat_to_rotvec,
    set3,
    sub,
)


@compiled
def carry_over(foot, start, speed, base, base_turn, duration, age, settings):
    """Begin an offset from the pose that will be followed to where the foot was: `start`.

    `speed` (3,) is the foot's against what it will follow, m/s.
    `base`, `base_turn` are the value, `age` seconds ago, of what is followed from now on.
    """
    if foot["known"] == 0 or duration <= 0.0:
        foot["offset_time"] = 0.0
        return
    offset = sub(start, base)
    twist = quat_to_rotvec(quat_mul(get4(foot["out_turn"]), quat_conj(base_turn)))
    set3(foot["offset"], offset)
    set3(foot["offset_speed"], limited_velocity(offset, speed, duration, settings["size"]))
    set3(foot["twist"], twist)
    foot["offset_age"], foot["offset_time"] = age, duration


@compiled
def with_offset(foot, base, base_turn):
    """The pose that is followed, with what is still carried over."""
    age, duration = foot["offset_age"], foot["offset_time"]
    if age >= duration:
        return base, base_turn
    offset = decayed(get3(foot["offset"]), get3(foot["offset_speed"]), age, duration)
    twist = decayed(get3(foot["twist"]), (0.0, 0.0, 0.0), age, duration)
    return add(base, offset), quat_mul(quat_from_rotvec(twist), base_turn)
