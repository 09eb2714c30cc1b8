"""Lights told wrongly come right by the parts that are recognised; what cannot be told is said."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from scipy.spatial.transform import Rotation

from itree_jax.detections import Detection, Detections
from itree_jax.refinement.light_corrections import corrections_in_words, lights_document, pooled_lights
from itree_jax.refinement.lit_pixels import BLOCK, STRIDE, PlacedPart, lit_pixels, sighted
from itree_jax.refinement.optimise import RefineModel, padded_normals
from itree_jax.refinement.self_calibration import calibrated_by_answers, self_calibrate
from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.simulate.bin import Bin
from itree_jax.simulate.imaging import LOOKS, ImageNoise, image_bin

SENSOR = replace(bundled_sensor("bench"), camera=Camera("pinhole", 900.0, 900.0, 159.5, 119.5, 320, 240))
BIN = Bin((260.0, 190.0), 1.0)
PLACES = ((-65.0, 0.0, 25.0), (10.0, 40.0, 26.0), (60.0, -35.0, 25.0))  # [mm], on the floor and apart
TURNS = ((0.3, 0.2, 0.5), (-0.5, 0.4, 2.0), (0.2, -0.6, 3.6))  # rotation vectors


@cache
def part():
    return bundled_part("bracket")


@cache
def model() -> RefineModel:
    from itree_kernels.mesh import ray_mesh

    p = part()
    mesh = ray_mesh(p.vertices, p.triangles, p.face_of_triangle, device="cpu")
    reach = float(np.linalg.norm(p.vertices, axis=1).max())
    return RefineModel(mesh, padded_normals(mesh.triangle_normals), reach, p.diameter)


@cache
def imaged(look: str, noise: bool = True):
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(TURNS).as_matrix()
    centre = part().vertices.mean(axis=0)
    T[:, :3, 3] = np.array(PLACES) - T[:, :3, :3] @ centre
    return image_bin(part(), T, BIN, SENSOR, LOOKS[look], ImageNoise(noise, 0.3), seed=1)


def placed(look: str = "lambert") -> list[PlacedPart]:
    return [PlacedPart(model(), true.R_cam_obj, true.t_cam_obj) for true in imaged(look)[1]]


def told_wrong(degrees: float = 1.0, percent: float = 2.0):
    L = SENSOR.light_directions
    axis = np.cross(L, np.array([[0.3, 1.0, 0.2], [1.0, -0.3, 0.4], [-0.5, 0.2, 1.0]]))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    e = SENSOR.light_intensities * (1.0 + percent / 100.0 * np.array([1.0, -1.0, 1.0]))
    return replace(
        SENSOR, light_directions=Rotation.from_rotvec(np.radians(degrees) * axis).apply(L), light_intensities=e
    )


def errors(found) -> tuple[float, float]:
    """[deg] and relative, the scale of the intensities taken out."""
    angle = np.linalg.norm(found.light_directions - SENSOR.light_directions, axis=1)
    ratio = found.light_intensities / SENSOR.light_intensities
    return float(np.degrees(angle).max()), float(np.abs(ratio / ratio.mean() - 1.0).max())


@cache
def corrected():
    scene, _ = imaged("lambert")
    return self_calibrate(placed(), scene.images, told_wrong(), scene.depth)


def test_one_degree_and_two_percent_vanish():
    found = corrected()
    angle, ratio = errors(found)
    assert angle < 0.2
    assert ratio < 0.003
    assert found.kept
    assert found.residual_after < 0.7 * found.residual_before
    assert np.degrees(found.direction_change) == pytest.approx([1.0] * 3, abs=0.2)
    np.testing.assert_allclose(found.sensor.light_directions, found.light_directions)
    assert found.unobserved == ()


def test_the_errors_are_within_what_is_predicted():
    found = corrected()
    angle, ratio = errors(found)
    assert angle < 3.0 * np.degrees(found.direction_std.max())
    assert ratio < 3.0 * found.intensity_std.max()
    assert np.degrees(found.direction_std.max()) < 0.6


def test_the_gauge_is_the_mean_intensity():
    found = corrected()
    assert found.light_intensities.mean() == pytest.approx(found.told.light_intensities.mean(), rel=1e-9)
    brighter = replace(told_wrong(), light_intensities=2.0 * told_wrong().light_intensities)
    scene, _ = imaged("lambert")
    doubled = self_calibrate(placed(), scene.images, brighter, scene.depth)
    np.testing.assert_allclose(doubled.light_intensities, 2.0 * found.light_intensities, rtol=1e-3)
    np.testing.assert_allclose(2.0 * np.array(doubled.albedo), found.albedo, rtol=1e-3)


def test_poses_that_are_off_come_right_too():
    scene, truth = imaged("lambert")
    turn = Rotation.from_rotvec(np.radians(0.5) * np.array([0.6, 0.0, 0.8])).as_matrix()
    off = [replace(p, R_cam_obj=turn @ p.R_cam_obj, t_cam_obj=p.t_cam_obj + 0.3) for p in placed()]
    found = self_calibrate(off, scene.images, told_wrong(), scene.depth)
    assert errors(found)[0] < 0.25
    for true, part_found in zip(truth, found.parts, strict=True):
        left = Rotation.from_matrix(true.R_cam_obj.T @ part_found.R_cam_obj).magnitude()
        assert np.degrees(left) < 0.2


def test_without_depth_a_turn_of_everything_is_not_observed():
    scene, _ = imaged("lambert")
    found = self_calibrate(placed(), scene.images, told_wrong(), None)
    assert any("a turn of all lights together" in words for words in found.unobserved)
    assert found.direction_std.max() > 2.0 * corrected().direction_std.max()
    # what is left is (mostly) one turn of all three
    turn, _ = Rotation.align_vectors(SENSOR.light_directions, found.light_directions)
    rest = np.linalg.norm(turn.apply(found.light_directions) - SENSOR.light_directions, axis=1)
    assert np.degrees(rest.max()) < 0.6


def test_gloss_is_not_taken_for_the_lights():
    scene, _ = imaged("metal")
    found = self_calibrate(placed("metal"), scene.images, SENSOR, scene.depth)
    assert not found.kept
    assert found.sensor is found.told
    assert found.patch_bias > 0.017
    assert "not used" in corrections_in_words(found)


def test_nothing_to_go_by():
    scene, _ = imaged("lambert")
    with pytest.raises(ItreeError, match="at least one recognised part"):
        self_calibrate([], scene.images, SENSOR, scene.depth)
    with pytest.raises(ItreeError, match="shows a pixel that a light reaches"):
        self_calibrate(placed(), np.ones_like(scene.images), SENSOR, scene.depth)
    near = replace(SENSOR, light_positions=600.0 * SENSOR.light_directions + np.array([0.0, 0.0, 900.0]))
    with pytest.raises(ItreeError, match="distant lights only"):
        self_calibrate(placed(), scene.images, near, scene.depth)


def test_pixels_compared_are_lit_unsaturated_and_inside_faces():
    scene, _ = imaged("lambert", noise=False)
    images = scene.images.copy()
    images[0, :, ::4] = 1.0  # saturated columns
    seen = sighted(images, scene.depth, SENSOR, allowed=3.0)
    table = lit_pixels(seen, placed(), SENSOR.light_directions * SENSOR.light_intensities[:, None])
    pixels = table.pixels
    assert pixels.used.sum(axis=0).min() > 200
    assert not (pixels.used & (pixels.intensity >= 1.0)).any()
    predicted = 0.7 * pixels.normal @ SENSOR.light_directions.T
    np.testing.assert_allclose(pixels.intensity[pixels.used], predicted[pixels.used], atol=2e-5)
    both = [table.half(even).used.sum() for even in (True, False)]
    assert sum(both) == pixels.used.sum()
    assert min(both) > 0.4 * sum(both)
    assert BLOCK % STRIDE == 0
    assert len(pixels.part) % 4096 == 0


def test_by_answers_takes_the_sure_ones(paper_tree):
    from itree_jax.prepared import prepare

    scene, truth = imaged("lambert")
    prepared = prepare(paper_tree)
    prepared = replace(prepared, model=model())
    scores = (0.9, 0.3, 0.8)
    answers = Detections(tuple(
        Detection(1, 0, paper_tree.obj_id, score, true.R_cam_obj, true.t_cam_obj)
        for score, true in zip(scores, truth, strict=True)
    ))  # fmt: skip
    found = calibrated_by_answers(answers, [prepared], scene.images, told_wrong(), scene.depth)
    assert found is not None
    assert len(found.parts) == 2
    assert calibrated_by_answers(answers, [prepared], scene.images, SENSOR, scene.depth, least_score=0.95) is None
    assert calibrated_by_answers(answers, [prepared], np.ones_like(scene.images), SENSOR, scene.depth) is None


def test_many_scenes_are_pooled_by_their_precision():
    one = corrected()
    coarse = replace(one, direction_std=10 * one.direction_std, intensity_std=10 * one.intensity_std,
                     light_intensities=1.1 * one.light_intensities)  # fmt: skip
    refused = replace(one, kept=False, light_intensities=2.0 * one.light_intensities)
    pooled = pooled_lights([one, coarse, refused])
    assert pooled is not None
    np.testing.assert_allclose(pooled[1], one.light_intensities * (1 + 0.1 / 101), rtol=1e-6)
    np.testing.assert_allclose(pooled[0], one.light_directions, atol=1e-6)
    document = lights_document({"000001": one, "000002": refused})
    assert document["scenes"]["000002"]["kept"] is False
    assert document["lights"]["directions"] == pytest.approx(np.asarray(one.light_directions))
    other_rig = replace(one, told=SENSOR)
    assert "lights" not in lights_document({"a": one, "b": other_rig})
    assert "lights" not in lights_document({"a": refused})
