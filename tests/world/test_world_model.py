"""The world model of scenes whose answers are the true poses."""

import json
from dataclasses import replace

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.errors import ItreeError

from itree_jax.detections import Detection, Detections
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.scene_folder import Scene
from itree_jax.simulate.bin import bin_for, walls_of
from itree_jax.simulate.demo import bundled_poses
from itree_jax.simulate.imaging import image_bin
from itree_jax.world import load_bin, to_scene, world_meshes, world_model
from itree_jax.world.bin_walls import write_bin
from itree_jax.world.model import NO_NEEDLES
from itree_jax.world.prism import corners_of_pixels

SENSOR = bundled_sensor("bench")
PART = bundled_part("ikeuchi-1987")


class Tree:
    """What the world model needs of a tree."""

    obj_id, part = 1, PART


def flat(z: float, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Lying on its two cylinders, in the middle of the bin."""
    T = np.eye(4)
    T[:3, 3] = (*at, z)
    return T


def found_at(truth, labels: np.ndarray, unexplained=()) -> Detections:
    answers = tuple(
        Detection(1, 0, 1, 1.0, one.R_cam_obj, one.t_cam_obj, offer_rank=k) for k, one in enumerate(truth)
    )
    return Detections(answers, labels=labels, not_recognised=tuple(unexplained))


@pytest.fixture(scope="module")
def two_parts():
    """Two parts beside each other, and the labels of two regions that are each one part's pixels."""
    bin_ = bin_for(SENSOR, PART.diameter)
    T_bin_obj = np.stack([flat(20.0, (-40.0, 0.0)), flat(20.0, (40.0, 0.0))])
    scene, truth = image_bin(PART, T_bin_obj, bin_, SENSOR, seed=0)
    labels = np.full(scene.depth.shape, -1, np.int32)
    seen = (scene.depth > 0) & (scene.depth < SENSOR.working_distance - 3.0)
    v, u = np.indices(labels.shape)
    seen &= (np.abs(u - 320) < 170) & (np.abs(v - 240) < 120)  # within the walls
    labels[seen] = (u >= 320)[seen]
    return scene, truth, labels, bin_


REGIONS = ({"region": 0, "reason": "a", "height_mm": 20.0}, {"region": 1, "reason": "b", "height_mm": 20.0})


def test_recognised_parts_leave_no_prism(two_parts):
    scene, truth, labels, bin_ = two_parts
    world = world_model(found_at(truth, labels, REGIONS), [Tree], SENSOR, scene.depth, scene.R_w2c,
                        walls_of(bin_, SENSOR))  # fmt: skip
    assert [part.index for part in world.parts] == [0, 1]
    assert not world.prisms
    assert world.floor == pytest.approx(-SENSOR.working_distance)


@pytest.mark.parametrize("known_bin", [True, False])
def test_a_part_that_is_not_recognised_is_a_prism_that_holds_it(two_parts, known_bin):
    scene, truth, labels, bin_ = two_parts
    walls = walls_of(bin_, SENSOR) if known_bin else None
    world = world_model(found_at(truth[:1], labels, REGIONS), [Tree], SENSOR, scene.depth, scene.R_w2c, walls)
    (prism,) = [p for p in world.prisms if p.region == 1]
    assert prism.reason == "b"
    assert prism.top - prism.bottom == pytest.approx(40.0, abs=2.5 if known_bin else 7.0)  # 90 % of a cylinder's height
    X = PART.vertices @ truth[1].R_cam_obj.T + truth[1].t_cam_obj
    high = (X @ world.R_cam_up)[X @ world.up_cam > world.floor + 25.0, :2]  # what is seen from above
    # mixed pixels along the outline may be missing
    grown = prism.outline_up.mean(axis=0) + 1.05 * (prism.outline_up - prism.outline_up.mean(axis=0))
    assert _inside(grown, high).all()


def test_unexplained_surface_without_a_region_is_an_obstacle_too(two_parts):
    scene, truth, labels, bin_ = two_parts
    nothing = np.full_like(labels, -1)
    world = world_model(found_at(truth[:1], nothing), [Tree], SENSOR, scene.depth, scene.R_w2c, walls_of(bin_, SENSOR))
    assert world.prisms
    assert {p.reason for p in world.prisms} == {NO_NEEDLES}
    u = np.concatenate([p.outline_up for p in world.prisms])[:, 0]
    assert u.min() > 0.0  # all of it where the second part is


def test_without_depth_a_region_is_as_tall_as_the_highest_part_and_wide_enough_at_any_depth(two_parts):
    scene, truth, labels, _ = two_parts
    world = world_model(found_at(truth[:1], labels, REGIONS), [Tree], SENSOR, None, scene.R_w2c)
    (prism,) = world.prisms
    top = max(part.X_cam @ world.up_cam for part in world.parts).max()
    assert prism.region == 1
    assert prism.top == pytest.approx(top)
    for depth in (-prism.top, -prism.bottom):
        pixels = corners_of_pixels(labels == 1, np.full(labels.shape, depth), SENSOR.camera, world.R_cam_up)
        inside = _inside(prism.outline_up, pixels[..., :2].reshape(-1, 2))
        assert inside.all()


def test_the_depth_that_parts_were_found_by_serves_where_no_map_is_given(two_parts):
    """As two cameras give it: a region that it leaves out is of unknown height, and none is forgotten."""
    scene, truth, labels, _ = two_parts
    found = found_at(truth[:1], labels, REGIONS)
    matched = np.where(labels >= 0, scene.depth, 0.0).astype(np.float32)
    (by_map,) = (p for p in world_model(found, [Tree], SENSOR, matched, scene.R_w2c).prisms if p.region == 1)
    found = replace(found, depth=matched)
    (by_match,) = (p for p in world_model(found, [Tree], SENSOR, None, scene.R_w2c).prisms if p.region == 1)
    assert by_match.top == by_map.top
    found = replace(found, depth=np.where(labels == 1, 0.0, matched).astype(np.float32))
    world = world_model(found, [Tree], SENSOR, None, scene.R_w2c)
    (unknown,) = (p for p in world.prisms if p.region == 1)
    assert unknown.top == pytest.approx(max(part.X_cam @ world.up_cam for part in world.parts).max())


def _inside(corners, points):
    side = np.roll(corners, -1, axis=0) - corners
    return np.all([s[0] * (points[:, 1] - c[1]) - s[1] * (points[:, 0] - c[0]) > -1e-6
                   for s, c in zip(side, corners, strict=True)], axis=0)  # fmt: skip


def test_all_meshes_are_solids_with_names_of_their_own_and_a_file_holds_them(two_parts, tmp_path):
    scene, truth, labels, bin_ = two_parts
    world = world_model(found_at(truth[:1], labels, REGIONS), [Tree], SENSOR, scene.depth, scene.R_w2c,
                        walls_of(bin_, SENSOR))  # fmt: skip
    meshes = world_meshes(world)
    assert len({one.name for one in meshes}) == len(meshes)
    assert all(one.mesh.is_volume for one in meshes)
    for one, prism in zip([m for m in meshes if m.kind == "prism"], world.prisms, strict=True):
        assert one.mesh.volume == pytest.approx(prism.volume, rel=1e-6)
    assert {"part", "prism", "bin", "floor"} == {one.kind for one in meshes}
    for name in ("world.glb", "world.ply"):
        to_scene(world).export(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 1000


def test_a_world_without_labels_or_parts_is_a_floor(two_parts):
    scene, *_ = two_parts
    world = world_model(Detections(), [Tree], SENSOR, scene.depth, scene.R_w2c)
    assert [one.name for one in world_meshes(world)] == ["floor"]


def test_a_scene_folder_tells_its_bin(two_parts, tmp_path):
    scene, _, _, bin_ = two_parts
    walls = walls_of(bin_, SENSOR)
    here = replace(scene, folder=tmp_path)
    assert load_bin(here) is None
    write_bin(walls, tmp_path)
    read = load_bin(here)
    np.testing.assert_allclose(read.T_cam_bin, walls.T_cam_bin)
    assert read.inner_size == pytest.approx(walls.inner_size)
    T = np.eye(4)
    T[:3, 3] = 1, 2, 3
    write_bin(walls, tmp_path, T_world_bin=T)
    np.testing.assert_allclose(load_bin(here).T_cam_bin, walls.T_cam_bin @ T)
    (tmp_path / "scene_bin.json").write_text(json.dumps({"0": {"inner_size": [1, -2]}}))
    with pytest.raises(ItreeError, match=r"scene_bin\.json.*wall_height"):
        load_bin(here)
    with pytest.raises(ItreeError, match="cam_R_w2c"):
        load_bin(replace(here, R_w2c=None))


def test_the_demos_bin_is_explained_by_its_true_poses():
    """Eight parts in a heap: nothing that is seen is left over."""
    _, bin_, T_bin_obj = bundled_poses()
    scene: Scene
    scene, truth = image_bin(PART, T_bin_obj, bin_, SENSOR, seed=3)
    labels = np.full(scene.depth.shape, -1, np.int32)
    world = world_model(found_at(truth, labels), [Tree], SENSOR, scene.depth, scene.R_w2c, walls_of(bin_, SENSOR))
    assert not world.prisms
