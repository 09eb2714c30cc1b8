"""A grasp in the physics engine: what a gripper truly touches on its way, and what its fingers hold."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from itree_cad.part import Part
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from itree_jax.grasp.body import Piece, pieces
from itree_jax.grasp.gripper import Gripper, Jaw
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.decompose import convex_pieces
from itree_jax.simulate.settle import METRE, Pieces, bin_spec, engine

STEP = 2.0  # [mm] along the approach: a third of a finger's thickness
DEEP = 0.3  # [mm]: parts are convex pieces in the engine, which contain the true ones to about this
SQUEEZE = 1.5  # [mm] that each finger or the cup goes beyond where it should touch: what is held is then touched


# Finer than for parts that only have to come to rest: a finger reaches into grooves and corners.
FINE_PIECES, FINE_EXCESS = 48, 1e-3


def fine_pieces(parts: Sequence[Part]) -> Pieces:
    """Convex pieces that leave a part's grooves and corners open, by `id(part)`."""
    return {key: convex_pieces(part, FINE_PIECES, FINE_EXCESS) for key, part in {id(p): p for p in parts}.items()}


class Touched(NamedTuple):
    """What one grasp meets among the true parts."""

    on_the_way: tuple[str, ...]  # "part 3", "bin": touched by the open gripper or while it closes, in this order
    held: tuple[int, ...]  # true parts that both fingers (or the cup) touch when closed


class TrueBin:
    """The true parts in the engine, and a gripper to be put anywhere among them."""

    def __init__(
        self, parts: Sequence[Part], T_bin_obj: Float[np.ndarray, "parts 4 4"], bin_: Bin, gripper: Gripper,
        fine: Pieces | None = None,
    ):
        self.mujoco, self.gripper, self.count = engine(), gripper, len(parts)
        spec = bin_spec(self.mujoco, parts, bin_, fine_pieces(parts) if fine is None else fine)
        for geom in spec.geoms:  # nothing but the gripper is looked at
            geom.contype, geom.conaffinity = 0, 1
        self.names = [piece.name for piece in _rigid(gripper, 0.0)]
        for piece in _rigid(gripper, 0.0):
            spec.add_mesh(name=piece.name, uservert=(piece.X_grip * METRE).ravel(),
                          inertia=self.mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX)  # fmt: skip
            body = spec.worldbody.add_body(name=piece.name)
            body.add_freejoint()
            geom = body.add_geom(type=self.mujoco.mjtGeom.mjGEOM_MESH, meshname=piece.name)
            geom.contype, geom.conaffinity = 1, 0
        self.model: Any = spec.compile()
        self.data: Any = self.mujoco.MjData(self.model)
        qpos = self.data.qpos.reshape(-1, 7)
        for k, T in enumerate(T_bin_obj):
            qpos[k] = _as_qpos(T)

    def touched(self, T_bin_grasp: Float[np.ndarray, "4 4"], width: float, target: int | None) -> Touched:
        """Puts the gripper at every `STEP` of its approach, then closes it.

        Of `target`, a true part, only what is deeper than the fingers open counts as touched: it is to be held.
        """
        met: dict[str, None] = {}
        for back in np.arange(self.gripper.distance, -1e-9, -STEP):
            self._put(T_bin_grasp, width, float(back), 0.0)
            met |= dict.fromkeys(name for name, _ in self._contacts())
        own = f"part {target}"
        if isinstance(self.gripper.tool, Jaw):  # closed to just before the part
            self._put(T_bin_grasp, width, 0.0, self.gripper.tool.open_by - SQUEEZE)
            met |= dict.fromkeys(name for name, _ in self._contacts() if name != own)
        elif own in met:  # a cup comes to touch its part
            del met[own]
        return Touched(tuple(met), self._held(T_bin_grasp, width))

    def _held(self, T_bin_grasp: Float[np.ndarray, "4 4"], width: float) -> tuple[int, ...]:
        """Parts that all that closes on them touches."""
        if isinstance(self.gripper.tool, Jaw):
            self._put(T_bin_grasp, width, 0.0, self.gripper.tool.open_by + SQUEEZE)
            closing = {"finger +x", "finger -x"}
        else:
            self._put(T_bin_grasp, width, -SQUEEZE, 0.0)
            closing = {"cup"}
        seen: dict[str, set[str]] = {}
        for name, piece in self._contacts():
            seen.setdefault(name, set()).add(piece)
        return tuple(k for k in range(self.count) if closing <= seen.get(f"part {k}", set()))

    def _put(self, T_bin_grasp: Float[np.ndarray, "4 4"], width: float, back: float, closed: float) -> None:
        """The gripper `back` [mm] before the grasp, each finger moved inward from where it is open by `closed` [mm]."""
        qpos = self.data.qpos.reshape(-1, 7)
        for k, name in enumerate(self.names):
            T = np.eye(4)
            side = {"finger +x": 1.0, "finger -x": -1.0}.get(name, 0.0)
            T[:3, 3] = side * (0.5 * width - closed), 0.0, -back
            qpos[self.count + k] = _as_qpos(T_bin_grasp @ T)
        self.mujoco.mj_kinematics(self.model, self.data)
        self.mujoco.mj_collision(self.model, self.data)

    def _contacts(self) -> list[tuple[str, str]]:
        """What the gripper's pieces are in, and which piece."""
        found = []
        for contact in self.data.contact[: self.data.ncon]:
            if contact.dist > -DEEP * METRE:
                continue
            bodies = [int(self.model.geom_bodyid[g]) - 1 for g in contact.geom]  # body 0 is the world: the bin
            thing, piece = sorted(bodies)
            found.append(("bin" if thing < 0 else f"part {thing}", self.names[piece - self.count]))
        return found


def _rigid(gripper: Gripper, width: float) -> list[Piece]:
    """The pieces that move as bodies."""
    return [piece for piece in pieces(gripper, width) if piece.arrives]


def _as_qpos(T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "7"]:
    """Place [m] and quaternion, w first."""
    return np.concatenate([T[:3, 3] * METRE, np.roll(Rotation.from_matrix(T[:3, :3]).as_quat(), 1)])
