"""Foot IK for MuJoCo characters: feet that land, hold, roll off and never slide."""

from footik_runtime.clip import Clip, Pose, blend
from footik_runtime.crowd import Crowd
from footik_runtime.errors import FootIKError
from footik_runtime.formats import load_clip, read_bvh, save_clip, write_bvh
from footik_runtime.ground import RecordedGround, SceneGround
from footik_runtime.humanoid import FootTarget, HumanoidFootIK
from footik_runtime.metrics import format_table, score
from footik_runtime.motion import Motion
from footik_runtime.offline.bake import bake
from footik_runtime.offline.clean import clean
from footik_runtime.offline.stages import BakeSettings, Cleaned, CleanSettings, Contacts
from footik_runtime.rig import Leg, Rig, Sole, find_rig
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings
from footik_runtime.skeleton import Skeleton
from footik_runtime.terrain import TERRAINS, Terrain, make_terrain
from footik_runtime.walk import Recording, record_walk

__version__ = "0.1.0"

__all__ = [
    "TERRAINS",
    "BakeSettings",
    "CleanSettings",
    "Cleaned",
    "Clip",
    "Contacts",
    "Crowd",
    "FootIKError",
    "FootIKSettings",
    "FootTarget",
    "HumanoidFootIK",
    "Leg",
    "Motion",
    "Pose",
    "RecordedGround",
    "Recording",
    "Rig",
    "Scene",
    "SceneGround",
    "Skeleton",
    "Sole",
    "Terrain",
    "bake",
    "blend",
    "clean",
    "find_rig",
    "format_table",
    "load_clip",
    "make_terrain",
    "read_bvh",
    "record_walk",
    "save_clip",
    "score",
    "write_bvh",
]
