"""FootIKSettings: every number a user may tune, with presets; scaled to the body when used."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import Any, Literal

import numpy as np

from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.rig import Rig

STANDARD_LEG = 0.85
"""Leg length in metres at which lengths in the settings hold as they are."""

_LENGTHS = (
    "step_height",
    "stride_distance",
    "ground_above",
    "ground_below",
    "ground_below_swing",
    "max_hip_raise",
    "max_hip_speed",
    "largest_step",
    "foothold_shift",
    "foothold_lead",
    "clearance",
    "swing_lift",
    "replan_distance",
    "max_hip_drop",
    "max_stride_drop",
    "max_hip_foot",
    "foot_height",
)


@dataclass(frozen=True, kw_only=True)
class FootIKSettings:
    """How feet are placed. Lengths are for a leg of 0.85 m and scale with the leg.

    Attributes:
        behaviour: "default", or "openkcc": OpenKCC's own state machine, faults and all.
        weight_on: a released foot is placed when its IK weight rises to this, in (0, 1].
        weight_off: a grounded foot is released when its IK weight falls below this; less than
            `weight_on`, so that no weight makes it chatter.
        place_time: s in which a swinging foot is blended onto its foothold, before contact where
            the plant is known ahead, after it otherwise.
        release_time: s in which a released foot returns to the animation.
        settle_time: s in which a planted foot follows ground that sank or rose.
        stride_time: s of a bump stride: the step of a planted foot to a better place.
        step_height: m that a bump stride lifts the foot.
        stride_distance: m between a planted foot and the animated one that starts a bump stride.
        stride_angle_deg: degrees between them that start one.
        ground_above: m over the foot's ground from which rays are cast.
        ground_below: m under it to which they reach.
        largest_step: m that a foothold may lie above or below the root's ground.
        largest_slope_deg: degrees that a sole pitches with the ground at most.
        largest_roll_deg: degrees that a sole rolls with the ground at most.
        foothold_shift: m that a foothold may move along the foot to lie on even ground.
        uphill_lead: how much of the shift uphill that makes a leg as long at the plant as at the
            release prints are given, 0 to 1.
        foothold_lead: m of that shift at most.
        clearance: m that the swinging sole keeps over the ground it crosses.
        swing_lift: m by which the middle of every swing is raised.
        replan_distance: m that a predicted footprint may move before it is looked at again.
        flat_angle_deg: degrees of animated foot pitch, while planted, that count as flat.
        reach: part of the leg's length that is used before hips drop or heels lift, in (0.5, 1].
        max_heel_lift_deg: degrees that a heel lifts over the ball before a planted foot gives up.
        heel_first: part of that angle which is used before the hips drop.
        hip_half_life: s, of the spring that lowers the hips.
        hip_rise_half_life: s, of the spring that raises them again.
        max_hip_drop: m that the hips drop at most.
        max_stride_drop: m that they drop at most for a foot that steps on.
        hip_look_ahead: s before a plant in which the hips begin to drop for it.
        give_up_time: s before a release in which a contact is given up that its leg cannot reach.
        lean_half_life: s, of the spring that pitches and rolls a body of four legs with the ground.
        max_lean_deg: degrees that it does so at most, either way.
        root_half_life: s, of the spring that carries the root over the ground.
        blend_time: s in which foot IK, or one foot's, is switched on or off: from FK to IK.
        lock: what a planted foot keeps, where the clip has no lock curve: "full", "ball", "ankle"
            or "unlocked", see `LOCKS`.
        max_twist_deg: degrees that a planted foot is turned against the animated one at most.
        ray_reach: how far down rays look: "fixed": `ground_below`; "height": the less the higher
            the animated foot is; "curve": by its IK weight; "phase": all the way in contact only.
        ground_below_swing: m to which they reach at the least.
        hips: whether the hips move at all.
        hip_damping: of their springs: 1 is critical, less swings, more creeps.
        max_hip_speed: m/s of the hips against the animation.
        max_hip_raise: m that the hips rise at most, for a leg that would be too short.
        min_leg: part of its length that no leg shall be shorter than.
        hip_balance: how far the hips go sideways with the support, 0 to 1.
        knee_toe: how far the knee turns to where the toes point, 0 to 1.
        knee_out_deg: degrees that the knees are turned outward.
        max_knee_twist_deg: degrees that the knee is turned against the animation at most.
        max_stretch: how many times its length a leg may have, before its goal is given up.
        groups: geom groups that rays see, 0 to 5, one or more; a crowd's ground sees these.
        max_hip_foot: openkcc only: m, its max hip-foot distance.
        foot_height: openkcc only: m of the foot joint over the ground.
        hip_smooth_time: openkcc only: s.
        overlap_time: openkcc only: s, its overlap blend time.
        correct_overlap: openkcc only: cast the hips-to-foot rays.
    """

    behaviour: Literal["default", "openkcc"] = "default"
    weight_on: float = 0.55
    weight_off: float = 0.45
    place_time: float = 0.16
    release_time: float = 0.22
    settle_time: float = 0.15
    stride_time: float = 0.3
    step_height: float = 0.06
    stride_distance: float = 0.35
    stride_angle_deg: float = 45.0
    ground_above: float = 0.5
    ground_below: float = 0.6
    largest_step: float = 0.45
    largest_slope_deg: float = 40.0
    largest_roll_deg: float = 35.0
    foothold_shift: float = 0.15
    uphill_lead: float = 0.7
    foothold_lead: float = 0.25
    clearance: float = 0.02
    swing_lift: float = 0.015
    replan_distance: float = 0.05
    flat_angle_deg: float = 2.0
    reach: float = 0.975
    max_heel_lift_deg: float = 45.0
    heel_first: float = 0.7
    hip_half_life: float = 0.12
    hip_rise_half_life: float = 0.3
    max_hip_drop: float = 0.45
    max_stride_drop: float = 0.145
    hip_look_ahead: float = 0.5
    give_up_time: float = 0.23
    lean_half_life: float = 0.15
    max_lean_deg: float = 35.0
    root_half_life: float = 0.1
    blend_time: float = 0.3
    lock: Literal["full", "ball", "ankle", "unlocked"] = "full"
    max_twist_deg: float = 60.0
    ray_reach: Literal["fixed", "height", "curve", "phase"] = "fixed"
    ground_below_swing: float = 0.2
    hips: bool = True
    hip_damping: float = 1.0
    max_hip_speed: float = 4.0
    max_hip_raise: float = 0.2
    min_leg: float = 0.3
    hip_balance: float = 0.0
    knee_toe: float = 0.0
    knee_out_deg: float = 0.0
    max_knee_twist_deg: float = 45.0
    max_stretch: float = 1.0
    groups: tuple[int, ...] = (0,)
    max_hip_foot: float = 0.85
    foot_height: float = 0.05
    hip_smooth_time: float = 0.35
    overlap_time: float = 0.05
    correct_overlap: bool = True

    def __post_init__(self) -> None:
        if self.behaviour not in ("default", "openkcc"):
            raise unknown_name("behaviour", str(self.behaviour), ("default", "openkcc"))
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            kinds = (int, float, np.integer, np.floating)
            if isinstance(value, bool) or not (isinstance(value, kinds) and low <= value <= high):
                raise FootIKError(f"setting {name} must be in [{low:g}, {high:g}], not {value!r}.")
        if self.behaviour == "default" and not self.weight_off < self.weight_on:
            raise FootIKError(
                f"weight_off ({self.weight_off:g}) must be less than weight_on "
                f"({self.weight_on:g}), or a foot would be placed and released every frame."
            )
        for name in _SWITCHES:
            value = getattr(self, name)
            if not isinstance(value, (bool, np.bool_)):
                raise FootIKError(f"setting {name} must be True or False, not {value!r}.")
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                raise unknown_name(name, str(getattr(self, name)), choices)
        object.__setattr__(self, "groups", checked_groups(self.groups))

    @classmethod
    def openkcc(cls) -> FootIKSettings:
        """OpenKCC's foot IK with its own defaults: what its recorded traces were made with."""
        return cls(
            behaviour="openkcc",
            weight_on=0.5,
            weight_off=0.5,
            stride_time=0.25,
            step_height=0.1,
            stride_distance=0.75,
            stride_angle_deg=45.0,
            ground_below=1.5,
            max_hip_drop=0.45,
        )

    @classmethod
    def preset(cls, name: str) -> FootIKSettings:
        """Settings by name: "default" or "openkcc". Raises FootIKError for any other."""
        presets = {"default": cls, "openkcc": cls.openkcc}
        if not isinstance(name, str) or name not in presets:
            raise unknown_name("preset", str(name), presets)
        return presets[name]()

    def changed(self, **values: Any) -> FootIKSettings:
        """The same settings with these changed. Raises FootIKError for a name there is not."""
        names = [f.name for f in fields(self)]
        for name in values:
            if name not in names:
                raise unknown_name("setting", name, names)
        return replace(self, **values)

    def record(self, leg_length: float) -> Any:
        """The settings as one `SETTINGS` record for compiled code, for a leg of this length.

        Lengths are scaled for the default behaviour; OpenKCC's stay as they are, as in OpenKCC.
        Raises FootIKError for a leg that is not longer than 0 m.
        """
        if not (isinstance(leg_length, Real) and 0.0 < leg_length < math.inf):
            raise FootIKError(f"a leg must be longer than 0 m, and finite, not {leg_length} m.")
        out = np.zeros((), dtype=SETTINGS)
        size = leg_length / STANDARD_LEG if self.behaviour == "default" else 1.0
        for name in SETTINGS.names or ():
            if name == "size":
                out[name] = size
            elif name in CHOICES:
                out[name] = CHOICES[name].index(getattr(self, name))
            elif name + "_deg" in RANGES:
                out[name] = math.radians(getattr(self, name + "_deg"))
            else:
                out[name] = getattr(self, name) * (size if name in _LENGTHS else 1.0)
        return out[()]


def body_size(rig: Rig) -> float:
    """How large a rig's body is, in parts of the one whose legs are `STANDARD_LEG` long."""
    return float(rig.leg_lengths.mean()) / STANDARD_LEG


def settings_or_default(settings: FootIKSettings | None) -> FootIKSettings:
    """The settings, or the default ones for None. Raises FootIKError for anything else."""
    if settings is None:
        return FootIKSettings()
    if not isinstance(settings, FootIKSettings):
        raise FootIKError(f"settings must be a FootIKSettings, not {settings!r}.")
    return settings


def checked_groups(groups: Any) -> tuple[int, ...]:
    """Geom groups as a tuple of ints. Raises FootIKError unless there is one, and all are."""
    wrong = groups
    if isinstance(groups, (tuple, list)) and groups:
        bad = [g for g in groups if isinstance(g, bool) or not isinstance(g, (int, np.integer))]
        bad = bad or [g for g in groups if not 0 <= g <= 5]
        if not bad:
            return tuple(int(g) for g in groups)
        wrong = bad[0]
    raise FootIKError(f"groups must hold one or more geom groups 0 to 5, not {wrong!r}.")


RANGES: dict[str, tuple[float, float]] = {
    "weight_on": (0.01, 1.0),
    "weight_off": (0.0, 0.99),
    "place_time": (0.0, 2.0),
    "release_time": (0.0, 2.0),
    "settle_time": (0.0, 2.0),
    "stride_time": (0.0, 5.0),
    "step_height": (0.0, 1.0),
    "stride_distance": (0.01, 10.0),
    "stride_angle_deg": (1.0, 180.0),
    "ground_above": (0.05, 10.0),
    "ground_below": (0.05, 10.0),
    "largest_step": (0.01, 5.0),
    "largest_slope_deg": (0.0, 80.0),
    "largest_roll_deg": (0.0, 80.0),
    "foothold_shift": (0.0, 1.0),
    "uphill_lead": (0.0, 1.0),
    "foothold_lead": (0.0, 1.0),
    "clearance": (0.0, 0.5),
    "swing_lift": (0.0, 0.5),
    "replan_distance": (0.001, 1.0),
    "flat_angle_deg": (0.0, 20.0),
    "reach": (0.5, 1.0),
    "max_heel_lift_deg": (0.0, 80.0),
    "heel_first": (0.0, 1.0),
    "hip_half_life": (0.0, 5.0),
    "hip_rise_half_life": (0.0, 5.0),
    "max_hip_drop": (0.0, 5.0),
    "max_stride_drop": (0.0, 5.0),
    "hip_look_ahead": (0.0, 2.0),
    "give_up_time": (0.001, 2.0),
    "lean_half_life": (0.0, 5.0),
    "max_lean_deg": (0.0, 80.0),
    "root_half_life": (0.0, 5.0),
    "blend_time": (0.0, 5.0),
    "max_twist_deg": (0.0, 180.0),
    "ground_below_swing": (0.0, 10.0),
    "hip_damping": (0.1, 5.0),
    "max_hip_speed": (0.01, 100.0),
    "max_hip_raise": (0.0, 5.0),
    "min_leg": (0.0, 0.9),
    "hip_balance": (0.0, 1.0),
    "knee_toe": (0.0, 1.0),
    "knee_out_deg": (-90.0, 90.0),
    "max_knee_twist_deg": (0.0, 180.0),
    "max_stretch": (1.0, 1.5),
    "max_hip_foot": (0.01, 10.0),
    "foot_height": (0.0, 1.0),
    "hip_smooth_time": (0.0, 10.0),
    "overlap_time": (0.0, 5.0),
}

_SWITCHES = ("correct_overlap", "hips")

FIXED_REACH, REACH_BY_HEIGHT, REACH_BY_CURVE, REACH_BY_PHASE = range(4)

CHOICES: dict[str, tuple[str, ...]] = {
    "lock": ("full", "ball", "ankle", "unlocked"),
    "ray_reach": ("fixed", "height", "curve", "phase"),
}
"""Settings that are one of a few names; their records hold its number."""

SETTINGS = np.dtype(
    [(name.removesuffix("_deg"), "f8") for name in RANGES]
    + [(name, "f8") for name in (*_SWITCHES, *CHOICES, "size")],
    align=True,
)
"""`FootIKSettings` for compiled code: lengths scaled, angles in radians; size: leg / 0.85 m."""
