"""Parts dropped into a bin by a physics engine (MuJoCo, the extra `sim`)."""

from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
import trimesh
from itree_cad.part import Part
from itree_kernels.errors import ItreeError
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from itree_jax.simulate.bin import Bin
from itree_jax.simulate.decompose import convex_pieces

Pieces = Mapping[int, Sequence[Float[np.ndarray, "points 3"]]]

METRE = 1e-3  # the engine's contact defaults are made for metres
TIME_STEP = 1e-3  # [s]
CONTACT_TIME = 4e-3  # [s] of a contact's spring: stiff enough for parts to sink in by some hundredths of a mm
DENSITY = 2700.0  # [kg/m^3] aluminium; poses hardly depend on it
FRICTION = (0.5, 2e-4, 2e-5)  # sliding; turning and rolling [m]
TOP_SPEED = 0.7  # [m/s]: falling parts are braked to it, so that they neither bounce out nor pass through a wall
SPACING = 1.1  # of the diameter: the height between parts that fall one after another
CALM_AFTER = 0.6  # [s] after the last part has landed, motion begins to be damped ...
CALMING = 0.01  # ... by this fraction each step, so that round parts stop rolling
REST_SPEED = 2e-3  # [m/s] and [rad/s / 10]: a part slower than this lies still
REST_STEPS = 100  # all parts, for so many steps
LOST = 0.2  # [m] below the floor: a part that fell past the bin and goes on falling
TIME_LIMIT = 6.0  # [s] of calming after which parts are taken as they lie


def settle(part: Part, count: int, bin_: Bin, seed: int) -> Float[np.ndarray, "kept 4 4"]:
    """Poses T_bin_obj [mm] of the parts that lie in the bin after `count` were dropped, in the order they fell.

    Parts fall one after another from random attitudes and places; those that end outside the bin are left out, so fewer
    than `count` may come back. The same seed gives the same poses (on the same machine and version of the engine).
    Raises ItreeError if the physics engine is not installed or `count` is not positive.
    """
    return settle_mixed([part] * count, bin_, seed)[0]


def settle_mixed(
    parts: Sequence[Part], bin_: Bin, seed: int
) -> tuple[Float[np.ndarray, "kept 4 4"], Int[np.ndarray, "kept"]]:
    """`settle` for different parts, dropped in their order; also which of them lie in the bin."""
    mujoco = engine()
    count = len(parts)
    if count < 1:
        raise ItreeError(f"{count} parts cannot be dropped; at least one is needed.")
    rng = np.random.default_rng(seed)
    model = bin_spec(mujoco, parts, bin_).compile()
    data = mujoco.MjData(model)
    fall = _release(data, parts, bin_, rng)
    _run(mujoco, model, data, fall)
    poses = _poses(data, count)
    kept = _inside(parts, poses, bin_)
    return poses[kept], kept


def settle_from(
    parts: Sequence[Part], T_bin_obj: Float[np.ndarray, "parts 4 4"], bin_: Bin, pieces: Pieces | None = None
) -> tuple[Float[np.ndarray, "kept 4 4"], Int[np.ndarray, "kept"]]:
    """What lies where once parts at these poses are left to themselves: after one was taken from under others."""
    mujoco = engine()
    model = bin_spec(mujoco, parts, bin_, pieces).compile()
    data = mujoco.MjData(model)
    qpos = data.qpos.reshape(len(parts), 7)
    qpos[:, :3] = T_bin_obj[:, :3, 3] * METRE
    qpos[:, 3:] = np.roll(Rotation.from_matrix(T_bin_obj[:, :3, :3]).as_quat(), 1, axis=1)
    data.qpos[:] = qpos.ravel()
    _run(mujoco, model, data, 0.0)
    poses = _poses(data, len(parts))
    kept = _inside(parts, poses, bin_)
    return poses[kept], kept


def _inside(parts: Sequence[Part], poses: Float[np.ndarray, "parts 4 4"], bin_: Bin) -> Int[np.ndarray, "kept"]:
    middle = np.array([part.vertices.mean(axis=0) for part in parts])
    return np.flatnonzero(bin_.contains(np.einsum("kij,kj->ki", poses[:, :3, :3], middle) + poses[:, :3, 3]))


def engine() -> ModuleType:
    """MuJoCo. Raises ItreeError when it is not installed."""
    try:
        import mujoco
    except ImportError as error:
        raise ItreeError(
            'simulating a bin needs the physics engine MuJoCo, which is not installed: pip install "itree-jax[sim]"'
        ) from error
    return mujoco


def bin_spec(mujoco: Any, parts: Sequence[Part], bin_: Bin, pieces: Pieces | None = None) -> Any:
    """The bin and the parts, body "part0", "part1", ..., each free to move, for the engine to compile [m].

    `pieces` are the parts' convex pieces by `id(part)`, if they are known: to find them takes seconds.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = TIME_STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10  # friction as stiff as contact: parts on a slope do not creep
    for size, position in _boxes(bin_):
        geom = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size * METRE, pos=position * METRE)
        _surface(geom)
    kinds = list({id(part): part for part in parts}.values())
    of_kind = [convex_pieces(part) if pieces is None else pieces[id(part)] for part in kinds]
    for kind, of_part in enumerate(of_kind):
        for i, points in enumerate(of_part):
            spec.add_mesh(
                name=f"piece{kind}.{i}", uservert=(points * METRE).ravel(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
            )  # fmt: skip
    inertial = [_inertial(part) for part in kinds]
    for k, part in enumerate(parts):
        kind = next(j for j, known in enumerate(kinds) if known is part)
        body = spec.worldbody.add_body(name=f"part{k}", explicitinertial=True, **inertial[kind])
        body.add_freejoint()
        for i in range(len(of_kind[kind])):
            _surface(body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"piece{kind}.{i}"))
    return spec


def _surface(geom: Any) -> None:
    geom.friction, geom.condim = FRICTION, 6
    geom.solref = (CONTACT_TIME, 1.0)


def _boxes(bin_: Bin) -> list[tuple[np.ndarray, np.ndarray]]:
    """Half sizes and centres [mm] of floor and walls; the floor is thicker than the one seen, downward."""
    (x, y), h, w, deep = np.asarray(bin_.inner_size) / 2, bin_.wall_height / 2, bin_.wall_thickness / 2, 50.0
    boxes = [((x + 2 * w, y + 2 * w, deep), (0, 0, -deep))]
    boxes += [((w, y + 2 * w, h), (sign * (x + w), 0, h)) for sign in (-1, 1)]
    boxes += [((x, w, h), (0, sign * (y + w), h)) for sign in (-1, 1)]
    return [(np.array(size, float), np.array(position, float)) for size, position in boxes]


def _inertial(part: Part) -> dict[str, Any]:
    """Mass, centre and inertia of the part itself, not of the pieces, which overlap nothing but fill its holes."""
    solid = trimesh.Trimesh(part.vertices * METRE, part.triangles, process=False)
    solid = solid if solid.is_volume else solid.convex_hull
    inertia = solid.moment_inertia * DENSITY
    full = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return {"mass": solid.volume * DENSITY, "ipos": np.asarray(solid.center_mass), "fullinertia": full}


def _release(data: Any, parts: Sequence[Part], bin_: Bin, rng: np.random.Generator) -> float:
    """Puts the parts one above another at random attitudes and places; returns the time [s] of the fall."""
    count, diameter = len(parts), max(part.diameter for part in parts)
    middle = [(part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2 for part in parts]
    room = np.maximum(np.asarray(bin_.inner_size) / 2 - 0.55 * diameter, 0)
    heights = bin_.wall_height + diameter * (0.6 + SPACING * np.arange(count))
    attitudes = Rotation.random(count, rng=rng)
    qpos = data.qpos.reshape(count, 7)
    for k in range(count):
        place = np.array([*rng.uniform(-room, room), heights[k]])
        qpos[k, :3] = (place - attitudes[k].apply(middle[k])) * METRE
        qpos[k, 3:] = np.roll(attitudes[k].as_quat(), 1)  # the engine writes w first
    data.qpos[:] = qpos.ravel()
    return float(heights[-1] * METRE / TOP_SPEED)


def _run(mujoco: Any, model: Any, data: Any, fall: float) -> None:
    """Until all parts lie still."""
    calm, end, resting = fall + CALM_AFTER, fall + CALM_AFTER + TIME_LIMIT, 0
    while data.time < end and resting < REST_STEPS:
        mujoco.mj_step(model, data)
        speed = data.qvel.reshape(-1, 6)
        linear = np.linalg.norm(speed[:, :3], axis=1)
        speed[:, :3] *= np.minimum(1.0, TOP_SPEED / np.maximum(linear, TOP_SPEED))[:, None]
        if data.time > calm:
            speed *= 1 - CALMING
            resting = resting + 1 if _slow(speed[data.qpos.reshape(-1, 7)[:, 2] > -LOST]) else 0


def _slow(speed: Float[np.ndarray, "parts 6"]) -> bool:
    return bool((np.abs(speed) < REST_SPEED * np.array([1, 1, 1, 10, 10, 10])).all())


def _poses(data: Any, count: int) -> Float[np.ndarray, "parts 4 4"]:
    qpos = data.qpos.reshape(count, 7)
    T_bin_obj = np.tile(np.eye(4), (count, 1, 1))
    T_bin_obj[:, :3, :3] = Rotation.from_quat(np.roll(qpos[:, 3:], -1, axis=1)).as_matrix()
    T_bin_obj[:, :3, 3] = qpos[:, :3] / METRE
    return T_bin_obj
