"""The response of a material, measured on a sphere of it, reads another surface of the same material."""

from dataclasses import replace

import numpy as np

from itree_jax.sensing.bundled import bundled_sensor
from itree_jax.sensing.material_response import apply_response
from itree_jax.sensing.needle import NeedleMap
from itree_jax.sensing.photometric import needle_map
from itree_jax.sensing.sphere_response import response_of_sphere

from .rendered_spheres import BY_ORTHOGRAPHIC, matte, pixels


def glossy(sphere, directions):
    """Lambert's law and a broad lobe about the direction halfway between light and viewer."""
    _, normal, _ = sphere.at(pixels(sphere.camera))
    halfway = directions - np.array([0.0, 0.0, 1.0])
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    lit = normal @ directions.T > 0.0
    lobe = np.where(lit, np.maximum(normal @ halfway.T, 0.0) ** 8, 0.0)
    return 0.4 * matte(sphere, directions, np.ones(len(directions))) + 0.3 * np.moveaxis(
        np.nan_to_num(lobe), -1, 0
    ).astype(np.float32)


def errors(needle, sphere):
    """Median angle [rad] to the sphere's normals within 35 degrees of slant."""
    normal = sphere.at(pixels(sphere.camera))[1]
    within = np.nan_to_num(-normal[..., 2]) > np.cos(np.radians(35.0))
    there = within & np.asarray(needle.interpretable)
    assert there.sum() > 0.8 * within.sum()
    return float(np.median(np.arccos(np.clip((np.asarray(needle.normals) * normal).sum(-1)[there], -1, 1))))


def test_a_sphere_of_the_material_tells_how_to_read_another_surface_of_it():
    sensor = replace(bundled_sensor("ikeuchi-1987"), camera=BY_ORTHOGRAPHIC.camera)
    sphere = BY_ORTHOGRAPHIC
    other = replace(sphere, centre=sphere.centre + np.array([-6.0, 3.0, 0.0]), radius=30.0)
    response = response_of_sphere(glossy(sphere, sensor.light_directions), sensor, sphere)
    needle = NeedleMap(*(np.asarray(a) for a in needle_map(glossy(other, sensor.light_directions), sensor)))
    before, after = errors(needle, other), errors(apply_response(needle, response), other)
    assert before > np.radians(4.0)
    assert after < 0.25 * before


def test_a_lambertian_sphere_changes_nothing():
    sensor = replace(bundled_sensor("ikeuchi-1987"), camera=BY_ORTHOGRAPHIC.camera)
    images = 0.6 * matte(BY_ORTHOGRAPHIC, sensor.light_directions, np.ones(3))
    response = response_of_sphere(images, sensor, BY_ORTHOGRAPHIC)
    assert response.is_lambertian
