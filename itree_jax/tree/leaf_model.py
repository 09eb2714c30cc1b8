"""The work models of one representative attitude, as the paper stores and draws them (Ikeuchi 1987, sec. 2.1.3)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True)
class LeafModel:
    """Work models of an attitude group at its representative attitude; positions in the face frame of the target
    region: [mm] on the face from the mass centre, x along the maximum inertia direction."""

    R_cam_obj: Float[np.ndarray, "3 3"]
    mask: Bool[np.ndarray, "s s"]  # the target region in its window; empty where nothing is detectable
    pitch: float  # [mm] of a window pixel
    mean_normal: Float[np.ndarray, "3"]
    T: Float[np.ndarray, "2 2"]  # image offsets to face coordinates
    centroid: Float[np.ndarray, "2"]  # mass centre (x, y) [mm] in the image plane, from the window's centre
    inertia: Float[np.ndarray, "4"]  # I_max, I_min [mm^4], alpha [rad], uniqueness
    outline: Float[np.ndarray, "n_theta"]  # d(theta) [mm]
    egi: Float[np.ndarray, "cells"]  # [mm^2]
    mass_centre: Float[np.ndarray, "3"]  # of the EGI
    area: float  # [mm^2]
    shares: Float[np.ndarray, "5"]  # of the surface, per characteristic
    edges: Float[np.ndarray, "edges 4"]  # start and end (x, y, x, y)
    edge_strength: Float[np.ndarray, "edges"]
    areas: Float[np.ndarray, "areas 4 2"]  # rectangles of the surface characteristics: vertices
    area_characteristic: Int[np.ndarray, "areas"]
    area_surface: Float[np.ndarray, "areas"]  # [mm^2] of surface
    brothers: Float[np.ndarray, "most fields"]  # see `features.relation`
