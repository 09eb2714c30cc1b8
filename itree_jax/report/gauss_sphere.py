"""The extended Gaussian image on the half of the Gaussian sphere that faces the viewer (Ikeuchi 1987, sec. 2.1.3)."""

import numpy as np
from jaxtyping import Float

from itree_jax.features.egi import FREQUENCY
from itree_jax.report.markup import number
from itree_jax.report.work_model_figures import RIM, SIDE, closed, panel
from itree_jax.tree.dome import dome
from itree_jax.tree.leaf_model import LeafModel

LEAST_SHARE = 0.01  # of the fullest cell's mass: what is less is not seen
RADIUS = SIDE / 2 - RIM


def gauss_sphere(model: LeafModel) -> str:
    """Cells darker with their mass (as its root, so that little mass is seen too); the ring is the EGI mass centre.

    Camera frame: right and down as in the picture of the attitude.
    """
    cells = dome(FREQUENCY)
    toward = cells.directions[:, 2] < -1e-6  # those of `features.egi.visible_cells`
    corners = cells.triangles[toward]
    corners = corners / np.linalg.norm(corners, axis=2, keepdims=True)
    most = max(float(model.egi.max()), 1e-9)
    share = np.asarray(model.egi, float) / most
    ground = "".join(closed(on_disc(c)) for c in corners)
    mass = "".join(
        f'<path class="mass" fill-opacity="{share[k] ** 0.5:.2f}" d="{closed(on_disc(corners[k]))}"/>'
        for k in np.flatnonzero(share > LEAST_SHARE)
    )
    x, y = on_disc(np.asarray(model.mass_centre, float)[None])[0]
    middle = SIDE / 2
    return panel(
        f'<path class="cells" d="{ground}"/>{mass}<path class="axis" d="M{middle - 4:.0f} {middle:.0f}h8m-4 -4v8"/>'
        f'<circle class="centre" cx="{x:.1f}" cy="{y:.1f}" r="5"/>',
        f"extended Gaussian image; mass centre {number(np.linalg.norm(model.mass_centre), 2)} from the sphere's centre",
    )


def on_disc(directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Seen from the viewer [px]."""
    return SIDE / 2 + RADIUS * directions[:, :2]
