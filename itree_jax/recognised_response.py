"""The material's response from recognised parts: their poses tell the normal of every pixel that they show."""

from collections.abc import Sequence

import cv2
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.instances import Material
from itree_kernels.lit_scene import render_scene
from jaxtyping import Bool, Float

from itree_jax.answers import Interpretation
from itree_jax.sensing.material_response import MaterialResponse, fit_response
from itree_jax.sight import Sight

LEAST_PARTS = 2  # one part shows few normals, and may be wrong
LEAST_SCORE = 0.8  # one wrong pose among a few makes the material what it is not, and every right pose unlikely
BORDER = 2  # [px]: a pose's border may be another part's pixel


def responses_of_parts(answers: Sequence[Interpretation], sight: Sight) -> list[MaterialResponse] | None:
    """The response as each camera sees it; None where too few parts are recognised or none would help.

    Poses were found under the response used so far and lean toward it; the fit is robust, and kept only if it is
    nearer to the poses' normals in pixels that it was not fitted on.
    """
    bodies, R, t = posed_bodies(answers)
    if len(bodies) < LEAST_PARTS:
        return None
    views = [(sight.needle, sight.sensor.camera, R, t)]
    views += [
        (needle, view.camera, *view.poses(R, t)) for needle, view in zip(sight.beside, sight.others, strict=True)
    ]
    found = []
    for needle, camera, R_view, t_view in views:
        normals, known = shown_normals(bodies, R_view, t_view, camera)
        found.append(fit_response(needle, normals, known))
    return None if all(response.is_lambertian for response in found) else found


def posed_bodies(
    answers: Sequence[Interpretation],
) -> tuple[list[Interpretation], Float[np.ndarray, "parts 3 3"], Float[np.ndarray, "parts 3"]]:
    """The accepted poses that are believed, part -> camera [mm], and the answer that each comes from."""
    bodies = [(a, int(h)) for a in answers for h in a.selection.accepted if a.selection.score[h] >= LEAST_SCORE]
    R = [np.asarray(a.hypotheses.poses.R_cam_obj[h], float) for a, h in bodies]
    t = [np.asarray(a.hypotheses.poses.t_cam_obj[h], float) for a, h in bodies]
    return [a for a, _ in bodies], np.reshape(R, (-1, 3, 3)), np.reshape(t, (-1, 3))


def shown_normals(
    answers: Sequence[Interpretation], R: Float[np.ndarray, "parts 3 3"], t: Float[np.ndarray, "parts 3"],
    camera: Camera,
) -> tuple[Float[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"]]:
    """Normals that posed parts show [camera frame], and where, their borders left out."""
    meshes = [a.prepared.model.mesh for a in answers]
    straight_on = np.array([[0.0, 0.0, -1.0]])
    shown = render_scene(meshes, np.arange(len(meshes)), R, t, camera, straight_on, np.ones(1), Material())
    inside = np.zeros(shown.instance.shape, bool)
    kernel = np.ones((2 * BORDER + 1,) * 2, np.uint8)
    for k in range(len(meshes)):
        inside |= cv2.erode((shown.instance == k).astype(np.uint8), kernel) > 0
    return shown.normal, inside
