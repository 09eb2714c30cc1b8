"""Laws of parts at rest."""

import subprocess
import sys

import manifold3d
import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_cad.part import Part
from itree_kernels.errors import ItreeError
from scipy.spatial import ConvexHull

from itree_jax.simulate import Bin, bundled_poses, settle
from itree_jax.simulate.settle import engine

from ..primitives import box_part

BIN = Bin((120.0, 100.0), 20.0)


def placed(part: Part, T_bin_obj: np.ndarray) -> list[np.ndarray]:
    return [part.vertices @ T[:3, :3].T + T[:3, 3] for T in T_bin_obj]


def deepest_overlap(part: Part, T_bin_obj: np.ndarray) -> float:
    """Largest of the widths [mm], least over the normals of its hull, of what two parts have in common."""
    mesh = manifold3d.Mesh64(np.array(part.vertices, np.float64), np.array(part.triangles, np.uint64))
    mesh.merge()
    solids = [manifold3d.Manifold(mesh).transform(np.ascontiguousarray(T[:3])) for T in T_bin_obj]
    depth = 0.0
    for i in range(len(solids)):
        for j in range(i):
            for body in (solids[i] ^ solids[j]).decompose():
                hull = ConvexHull(np.asarray(body.to_mesh64().vert_properties)[:, :3])
                along = hull.points @ hull.equations[:, :3].T
                depth = max(depth, float(np.ptp(along, axis=0).min()))
    return depth


def test_one_box_rests_on_a_face():
    """One of its axes is vertical, and its centre is half of that side above the floor."""
    half = np.array([15.0, 10.0, 6.0])
    part = box_part(*2 * half)
    (T,) = settle(part, 1, BIN, seed=3)
    axis = int(np.abs(T[2, :3]).argmax())
    assert abs(T[2, axis]) == pytest.approx(1, abs=1e-4)
    centre = part.vertices.mean(axis=0) @ T[:3, :3].T + T[:3, 3]
    assert centre[2] == pytest.approx(half[axis], abs=0.05)


def test_three_boxes_do_not_pass_into_floor_walls_or_one_another():
    part = box_part(40, 30, 20)
    T_bin_obj = settle(part, 3, BIN, seed=0)
    assert len(T_bin_obj) == 3
    np.testing.assert_allclose(
        T_bin_obj[:, :3, :3] @ np.swapaxes(T_bin_obj[:, :3, :3], 1, 2), [np.eye(3)] * 3, atol=1e-9
    )
    for X in placed(part, T_bin_obj):
        assert X[:, 2].min() > -0.2
        low = X[X[:, 2] < BIN.wall_height]
        assert (np.abs(low[:, :2]) < np.array(BIN.inner_size) / 2 + 0.2).all()
    assert deepest_overlap(part, T_bin_obj) < 0.3


def test_the_same_seed_gives_the_same_poses_and_another_one_others():
    part = box_part(40, 30, 20)
    a, b, c = (settle(part, 2, BIN, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert np.abs(a[0] - c[0]).max() > 1.0


def test_parts_outside_are_left_out():
    """Eight boxes nearly as large as the bin cannot all stay in it."""
    part = box_part(60, 50, 40)
    T_bin_obj = settle(part, 8, Bin((90.0, 80.0), 10.0), seed=0)
    assert 1 <= len(T_bin_obj) < 8
    centres = np.array([X.mean(axis=0) for X in placed(part, T_bin_obj)])
    assert (np.abs(centres[:, :2]) < [45, 40]).all()


def test_the_bundled_poses_are_at_rest_in_their_bin():
    name, bin_, T_bin_obj = bundled_poses()
    part = bundled_part(name)
    assert len(T_bin_obj) == 8
    assert deepest_overlap(part, T_bin_obj) < 0.5
    lowest = np.array([X[:, 2].min() for X in placed(part, T_bin_obj)])
    assert lowest.min() > -0.2
    assert (lowest < 0.1).sum() >= 3  # it is a heap: some lie on the floor
    assert bin_.contains(T_bin_obj[:, :3, 3]).all()
    np.testing.assert_allclose(
        T_bin_obj[:, :3, :3] @ np.swapaxes(T_bin_obj[:, :3, :3], 1, 2), [np.eye(3)] * 8, atol=1e-8
    )
    np.testing.assert_allclose(np.linalg.det(T_bin_obj[:, :3, :3]), 1, atol=1e-8)


def test_a_missing_engine_is_named_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ItreeError, match=r'pip install "itree-jax\[sim\]"'):
        engine()


def test_importing_the_simulation_does_not_import_the_engine():
    code = "import sys, itree_jax.simulate; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=120, check=False).returncode == 0


def test_nothing_cannot_be_dropped():
    with pytest.raises(ItreeError, match="at least one"):
        settle(box_part(10, 10, 10), 0, BIN, seed=0)
