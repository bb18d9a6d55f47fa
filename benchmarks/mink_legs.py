"""The same legs solved with mink: a general IK solver on the character's MuJoCo model.

Each character-frame starts where our own legs start, from the animated pose with its hips lowered,
and goes to where our feet came to. The root is frozen, a posture task keeps what the feet leave
free, and it is iterated until both ankles are within a millimetre, five times at most.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime.builtin import HUMANOID
from footik_runtime.character import Character, build_character
from footik_runtime.crowd import Crowd
from footik_runtime.quat_arrays import conj, mul
from footik_runtime.rig import Rig
from footik_runtime.rooms import pose_rows

try:
    import mink as installed
except ImportError:
    installed = None

mink: Any = installed
"""The package, or None where it is not installed."""

CLOSE = 1e-3  # m
MOST_ROUNDS = 5
SOLVER = "daqp"


@dataclass(frozen=True, kw_only=True)
class Solved:
    """How it went, over some character-frames.

    Attributes:
        rounds: mean number of iterations.
        missed: part of them that ended with an ankle further off than `CLOSE`.
    """

    rounds: float
    missed: float


def lone_character(rig: Rig, builtin: bool) -> tuple[mujoco.MjModel, Character]:
    """A model of the character and nothing else."""
    if builtin:
        model = mujoco.MjModel.from_xml_path(str(HUMANOID))
        return model, Character.from_model(model, rig)
    spec = mujoco.MjSpec()
    build_character(spec, rig)
    model = spec.compile()
    return model, Character.bind(model, rig)


class MinkLegs:
    """Character-frames taken from a crowd, ready to be solved again and again."""

    def __init__(self, crowd: Crowd, builtin: bool, most: int) -> None:
        """Take the present frame of the first `most` characters, a block at most."""
        self._model, self._character = lone_character(crowd.motion.rig, builtin)
        self._configuration = mink.Configuration(self._model)
        rows = min(most, len(crowd.bodies), len(crowd.block.at))
        self.frames = rows
        self._starts = self._animated(crowd, rows)
        self._goals = [_goals(crowd, row) for row in range(rows)]
        bodies = [self._model.body(int(self._character.bodies[leg.ankle])).name
                  for leg in crowd.motion.rig.legs]  # fmt: skip
        self._feet = [
            mink.FrameTask(name, "body", position_cost=1.0, orientation_cost=0.2) for name in bodies
        ]
        self._posture = mink.PostureTask(self._model, cost=1e-3)
        self._frozen = mink.DofFreezingTask(self._model, dof_indices=list(range(6)))

    def _animated(self, crowd: Crowd, rows: int) -> NDArray[np.float64]:
        """(rows, nq) the animated poses, with our own hips' drop: what our legs begin with."""
        bodies = crowd.bodies[:rows].copy()
        roots, rotations = crowd.roots[:rows].copy(), crowd.rotations[:rows].copy()
        pose_rows(bodies, crowd.tables, roots, rotations, crowd.block)
        roots[:, 2] -= bodies["hip_drop"]
        data, poses = mujoco.MjData(self._model), []
        for root, turns in zip(roots, rotations, strict=True):
            self._character.write_pose(data, root, turns)
            poses.append(data.qpos.copy())
        return np.array(poses)

    def solve(self) -> Solved:
        """Solve every frame from its start."""
        results = [
            self._solve(q, goals) for q, goals in zip(self._starts, self._goals, strict=True)
        ]
        rounds, missed = np.array(results).T
        return Solved(rounds=float(rounds.mean()), missed=float(missed.mean()))

    def _solve(self, start: NDArray[np.float64], goals: list) -> tuple[int, bool]:
        configuration = self._configuration
        configuration.update(start)
        self._posture.set_target(start)
        for task, goal in zip(self._feet, goals, strict=True):
            task.set_target(goal)
        tasks = [*self._feet, self._posture]
        for done in range(MOST_ROUNDS + 1):
            if self._off() <= CLOSE or done == MOST_ROUNDS:
                break
            velocity = mink.solve_ik(
                configuration, tasks, 1.0, SOLVER, damping=1e-6, limits=[],
                constraints=[self._frozen],
            )  # fmt: skip
            configuration.integrate_inplace(velocity, 1.0)
        return done, self._off() > CLOSE

    def _off(self) -> float:
        """How far the worse ankle is from its goal, m."""
        return max(
            float(np.linalg.norm(task.compute_error(self._configuration)[:3]))
            for task in self._feet
        )


def _goals(crowd: Crowd, row: int) -> list:
    """Where the ankle bodies of one character came to."""
    goals = []
    for foot, leg in zip(crowd.feet[row], crowd.motion.rig.legs, strict=True):
        turn = mul(foot["out_turn"], conj(leg.sole.frame))
        goals.append(mink.SE3(np.concatenate([turn, foot["out"]])))
    return goals
