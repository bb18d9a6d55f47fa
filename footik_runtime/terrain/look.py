"""How terrain looks: calm colours, a checker that tells height and distance, sun and sky."""

from __future__ import annotations

import mujoco

GROUND = "terrain_ground"
GROUND_DARK = "terrain_ground_dark"
EDGE = "terrain_edge"
PIT = "terrain_pit"
GRASS = "terrain_grass"
STONE = "terrain_stone"
STONE_DARK = "terrain_stone_dark"
MOVING = "terrain_moving"

_COLOURS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    GROUND: ((0.62, 0.65, 0.66), (0.55, 0.58, 0.60)),
    GROUND_DARK: ((0.50, 0.56, 0.62), (0.44, 0.50, 0.56)),
    EDGE: ((0.72, 0.72, 0.69), (0.65, 0.65, 0.62)),
    PIT: ((0.27, 0.29, 0.32), (0.23, 0.25, 0.28)),
    GRASS: ((0.53, 0.62, 0.52), (0.46, 0.55, 0.46)),
    STONE: ((0.69, 0.63, 0.55), (0.66, 0.60, 0.52)),
    STONE_DARK: ((0.58, 0.52, 0.46), (0.55, 0.49, 0.43)),
    MOVING: ((0.80, 0.58, 0.36), (0.74, 0.52, 0.31)),
}
_SKY = ((0.50, 0.63, 0.78), (0.88, 0.91, 0.94))
_TEXTURE_REPEAT = 1.0  # makes squares of one metre


def has_look(spec: mujoco.MjSpec) -> bool:
    """Whether `add_look` was called on it before."""
    return spec.material(GROUND) is not None


def add_look(spec: mujoco.MjSpec) -> None:
    """Add the materials that pieces name, a sun with shadows, and a sky unless there is one."""
    for name, (light, dark) in _COLOURS.items():
        spec.add_texture(
            name=name,
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
            rgb1=light,
            rgb2=dark,
            width=128,
            height=128,
        )
        material = spec.add_material(name=name, texrepeat=[_TEXTURE_REPEAT] * 2, texuniform=True)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        material.specular, material.shininess = 0.1, 0.1
    _add_sky(spec)
    _add_sun(spec)


def _add_sky(spec: mujoco.MjSpec) -> None:
    if any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        return
    spec.add_texture(
        name="terrain_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=_SKY[0],
        rgb2=_SKY[1],
        width=256,
        height=1536,
    )


def _add_sun(spec: mujoco.MjSpec) -> None:
    """A low sun from the left and ahead, so that edges cast shadows and hills have a dark side."""
    spec.worldbody.add_light(
        name="terrain_sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[14.0, 8.0, 12.0],
        dir=[-0.28, -0.62, -0.68],
        diffuse=[0.85, 0.83, 0.77],
        specular=[0.1, 0.1, 0.1],
        castshadow=True,
    )
    spec.visual.headlight.ambient = [0.29, 0.30, 0.33]
    spec.visual.headlight.diffuse = [0.26, 0.26, 0.26]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.shadowsize = 4096
