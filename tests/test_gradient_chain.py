"""The whole chain can be differentiated where it is smooth: from images and lights through photometric stereo to the
loss that refinement minimises. In float64, so that central differences leave nothing to excuse.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from itree_cad.bundled import bundled_part
from itree_kernels.camera import Camera
from itree_kernels.correspond import correspondences
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from itree_kernels.mesh import ray_mesh
from scipy.spatial.transform import Rotation

from itree_jax.refinement.loss import LossWeights, loss_weights, refinement_loss
from itree_jax.refinement.observed import CameraArrays
from itree_jax.refinement.residuals import Deviations, Predicted, WindowObservations, depth_equations, needle_equations
from itree_jax.sensing.photometric import photometric_stereo
from itree_jax.sensor import Noise

CAMERA = Camera("pinhole", 200.0, 201.0, 31.4, 31.7, 64, 64)
NOISE = Noise()
SIZE, STRIDE = 30, 2
DEVIATIONS = Deviations(*map(np.float64, (0.3, 0.05, 6.0, 0.05, 0.03, 0.8, 0.5, 0.15, 8.0)))


class Chain(NamedTuple):
    """A part lit by four lights, seen from a pose that is some degrees and millimetres off. NumPy, float64."""

    R: np.ndarray
    t: np.ndarray
    predicted: Predicted
    images: np.ndarray
    L: np.ndarray
    e: np.ndarray
    depth: np.ndarray
    normal_obj: np.ndarray


def lights() -> tuple[np.ndarray, np.ndarray]:
    azimuth, s, c = np.radians([80.0, 170.0, 260.0, 350.0]), np.sin(np.radians(30)), np.cos(np.radians(30))
    return np.stack([s * np.cos(azimuth), s * np.sin(azimuth), np.full(4, -c)], axis=1), np.array([0.8, 0.9, 1.0, 0.85])


@pytest.fixture(scope="module")
def chain() -> Chain:
    part = bundled_part("bracket")
    mesh = ray_mesh(part.vertices, part.triangles, part.face_of_triangle, device="cpu")
    R = Rotation.from_rotvec([2.5, 0.5, -0.4]).as_matrix()
    t = np.array([0.0, 0.0, 300.0]) - R @ mesh.centre
    L, e = lights()
    lit = render_scene([mesh], [0], R[None], t[None], CAMERA, L, e, Material(0.8))
    # the pixels' own error keeps the residuals of four lights away from 0, where a fit would be trivial
    images = lit.images * (1.0 + np.random.default_rng(0).normal(0.0, 3e-3, lit.images.shape))
    R_off, t_off = Rotation.from_rotvec([0.03, -0.05, 0.04]).as_matrix() @ R, t + np.array([0.6, -0.8, 1.0])
    origin = np.array([[2.0, 2.0]])
    reach = float(np.linalg.norm(mesh.vertices, axis=1).max())
    found = correspondences(mesh, R_off[None], t_off[None], CAMERA, origin, SIZE, STRIDE, reach)
    nothing = np.zeros((2, SIZE, SIZE, 2)), np.zeros((2, SIZE, SIZE))
    predicted = Predicted(origin[0], found.depth[0].astype(float), found.triangle[0], *nothing)
    normal_obj = mesh.triangle_normals.astype(float)
    return Chain(R_off, t_off, predicted, images, L, e, lit.depth.astype(float), normal_obj)


def camera_arrays() -> CameraArrays:
    return CameraArrays(*(jnp.asarray(v, float) for v in (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 1.0)))


def weights_of(chain: Chain) -> LossWeights:
    needle = photometric_stereo(chain.images, chain.L, chain.e, NOISE)
    return loss_weights(
        chain.R, chain.predicted, needle, chain.depth, chain.normal_obj, camera_arrays(), DEVIATIONS, STRIDE
    )


def loss_of(chain: Chain):
    """The loss of (twist, images, light directions, light intensities), all else fixed."""
    weights, camera = weights_of(chain), camera_arrays()

    @jax.jit
    def loss(twist, images, L, e):
        return refinement_loss(
            twist, chain.R, chain.t, chain.predicted, weights, images, L, e, NOISE, chain.depth, chain.normal_obj,
            camera, STRIDE,
        )  # fmt: skip

    return loss


def central_difference(f, arguments, which: int, index, step: float) -> float:
    ends = []
    for sign in (1.0, -1.0):
        changed = [a.copy() for a in arguments]
        changed[which][index] += sign * step
        ends.append(float(f(*changed)))
    return (ends[0] - ends[1]) / (2 * step)


def test_gradient_through_the_chain_is_the_finite_difference(chain):
    """With respect to pose, images, light directions and intensities, at a pose that is off and at another twist."""
    with jax.enable_x64(True):
        loss = loss_of(chain)
        gradient = jax.jit(jax.grad(loss, argnums=(0, 1, 2, 3)))
        for twist in (np.zeros(6), np.array([0.01, 0.02, -0.03, 0.5, -0.2, 0.4])):
            arguments = [twist, chain.images.astype(float), chain.L, chain.e]
            found = [np.asarray(g) for g in gradient(*arguments)]
            brightest = np.argsort(-np.abs(found[1]).ravel())[:4]
            indices = {
                0: list(np.ndindex(6)),
                1: [np.unravel_index(k, chain.images.shape) for k in brightest],
                2: list(np.ndindex(4, 3)),
                3: list(np.ndindex(4)),
            }
            for which, some in indices.items():
                numeric = [central_difference(loss, arguments, which, index, 1e-6) for index in some]
                analytic = [found[which][index] for index in some]
                scale = np.abs(numeric).max()
                assert scale > 0.1
                np.testing.assert_allclose(analytic, numeric, rtol=1e-5, atol=1e-6 * scale)


def test_gradient_at_rest_is_that_of_the_normal_equations(chain):
    """So Gauss-Newton descends this loss."""
    with jax.enable_x64(True):
        needle = photometric_stereo(chain.images, chain.L, chain.e, NOISE)
        v, u = (chain.predicted.origin_uv[::-1, None, None] + STRIDE * np.mgrid[:SIZE, :SIZE]).astype(int)
        believed = np.where(needle.interpretable, needle.confidence, 0.0)
        window = WindowObservations(
            np.stack([u, v], axis=-1).astype(float), chain.depth[v, u], np.asarray(needle.normals)[v, u], believed[v, u]
        )
        gap = window.depth - chain.predicted.depth
        of_depth = depth_equations(
            chain.R, chain.t, chain.predicted, window, jnp.asarray(chain.normal_obj), camera_arrays(), DEVIATIONS
        )
        of_needle = needle_equations(chain.R, chain.predicted, window, jnp.asarray(chain.normal_obj), DEVIATIONS, gap)
        expected = np.asarray(of_depth.gradient + of_needle.gradient)
        arguments = (jnp.zeros(6), jnp.asarray(chain.images, float), chain.L, chain.e)
        loss = loss_of(chain)
        np.testing.assert_allclose(jax.grad(loss)(*arguments), expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
        assert float(loss(*arguments)) == pytest.approx(0.5 * float(of_depth.cost + of_needle.cost), rel=1e-6)


def test_the_weights_leave_out_what_is_not_compared(chain):
    with jax.enable_x64(True):
        weights = weights_of(chain)
        missed = chain.predicted.triangle < 0
        needle = photometric_stereo(chain.images, chain.L, chain.e, NOISE)
        v, u = (chain.predicted.origin_uv[::-1, None, None] + STRIDE * np.mgrid[:SIZE, :SIZE]).astype(int)
        assert not np.asarray(weights.depth)[missed | (chain.depth[v, u] == 0)].any()
        assert not np.asarray(weights.needle)[missed | ~np.asarray(needle.interpretable)[v, u]].any()
        assert (np.asarray(weights.depth) > 0).sum() > 100
        assert (np.asarray(weights.needle) > 0).sum() > 100


def test_descent_in_the_loss_goes_toward_the_pose(chain):
    """A small step against the gradient lowers it."""
    with jax.enable_x64(True):
        loss = loss_of(chain)
        at = partial(loss, images=chain.images.astype(float), L=chain.L, e=chain.e)
        gradient = np.asarray(jax.grad(at)(np.zeros(6)))
        scaled = gradient / np.array([1, 1, 1, 1e-4, 1e-4, 1e-4])  # a radian moves a rim of 100 mm
        step = -1e-4 * scaled / np.linalg.norm(scaled)
        assert float(at(step)) < float(at(np.zeros(6)))
