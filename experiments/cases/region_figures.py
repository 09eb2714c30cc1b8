"""Figures 6a, 7b, 8b: the target region, the square of its original face, and its brother region."""

import numpy as np
from itree_kernels.mesh import RayMesh
from jaxtyping import Float

from cases.canvas import Canvas, box_around, dimmed
from cases.highest_region import HIGHEST, seen_alone
from cases.recognised import Recognised
from cases.two_rotations import best_brother, brother_misfits
from itree_jax.features.relation import ACROSS, ALONG, FACING, MOST_MISFIT, OUT, SIZE, THERE
from itree_jax.report.markup import count_of, figure, image, number, swatches, table
from itree_jax.report.palette import GREEN, ORANGE, SKY, WHITE, Rgb, css

FIGURE = {1: "6a", 2: "7b", 3: "8b"}
MEASURED, MODEL, BROTHER = ORANGE, SKY, GREEN


def square_sides(I_max: float, I_min: float) -> tuple[float, float]:
    """Sides [mm] along and across of the rectangle with these second moments [mm^4]: a^3 b / 12 and a b^3 / 12."""
    return (12 * I_max) ** 0.375 / (12 * I_min) ** 0.125, (12 * I_min) ** 0.375 / (12 * I_max) ** 0.125


def corners(sides: tuple[float, float]) -> Float[np.ndarray, "4 2"]:
    a, b = sides
    return 0.5 * np.array([[a, b], [-a, b], [-a, -b], [a, -b]])


def target_canvas(r: Recognised, brightness: float = 1.0) -> Canvas:
    """The target region large, the rest dim."""
    mask = r.measured.found.mask(HIGHEST)
    background = (brightness * r.view.background).astype(np.uint8)
    return Canvas(dimmed(background, mask), box_around(mask))


def region_figure(r: Recognised) -> str:
    """The region with the square of the same inertia and direction, drawn through the inverse of T."""
    canvas, frame = target_canvas(r), r.frame
    inertia = r.features.inertia
    sides = square_sides(float(inertia.I_max), float(inertia.I_min))
    model = r.models[0]
    model_sides = square_sides(model.I_max, model.I_min)
    canvas.outline(frame.face_to_image(corners(model_sides)), MODEL, dashed=True)
    canvas.outline(frame.face_to_image(corners(sides)), MEASURED, 3)
    canvas.line(frame.face_to_image(np.array([[-0.5, 0.0], [0.5, 0.0]]) * sides[0]), MEASURED, 1)
    canvas.dot(frame.face_to_image(np.zeros(2)))
    slant = np.degrees(np.arccos(-frame.mean_normal[2]))
    legend = swatches([(css(MEASURED), "this region"), (css(MODEL), "the model (broken line)")])
    caption = (
        f"On the face, whose slant is {number(slant)}°: I_max {shown(float(inertia.I_max))} and I_min "
        f"{shown(float(inertia.I_min))} mm⁴, a rectangle of {number(sides[0])} by {number(sides[1])} mm. The model of "
        f"{r.case.name}, region of faces {model.faces}: {shown(model.I_max)} and {shown(model.I_min)} mm⁴, "
        f"{number(model_sides[0])} by {number(model_sides[1])} mm."
    )
    title = f"{FIGURE[r.case.number]} · Target region and original face inertia"
    return figure(image(canvas.picture, "target region with its inertia square"), title, caption, legend)


def shown(moment: float) -> str:
    """A moment in thousands, as "412 k"."""
    return f"{moment / 1000.0:.0f} k"


def brother_figure(r: Recognised, mesh: RayMesh) -> str:
    """The target region joined with the region that fits best as its brother, and the vector between them."""
    misfit = brother_misfits(r)
    k, beside = best_brother(r), int(r.features.brothers[:, THERE].sum())
    if misfit[k] >= MOST_MISFIT:
        said = "No other region lies within reach of the target: it has no brother."
        if beside:
            said = f"{count_of(beside, 'region')} beside the target; none looks like the brother that S2 would show."
        return figure(f'<p class="empty">{said}</p>', "Brother region")
    other = region_of_brother(r, k)
    found = r.measured.found
    both = found.mask(HIGHEST) | found.mask(other)
    canvas = Canvas(dimmed(r.view.background, both), box_around(both, margin=0.12))
    ends = found.centroid_uv[[HIGHEST, other]]
    canvas.line(ends, BROTHER, 3)
    for uv, words, colour in zip(ends, ("target", "brother"), (WHITE, BROTHER), strict=True):
        canvas.dot(uv, colour)
        canvas.label(uv + np.array([0.0, 14.0]), words, colour)
    alone, _ = seen_alone(r.measured, mesh)
    share = float(np.mean(alone[found.mask(other)]))
    truth = "the same part" if share > 0.5 else "another part"
    caption = (
        f"{relation_table(r, k)}They differ by {number(misfit[k])} sigma of the spread that L6 allows for. In truth "
        f"the brother region shows {truth}."
    )
    return figure(image(canvas.picture, "target and brother region"), "7b · Target region and brother region", caption)


def region_of_brother(r: Recognised, k: int) -> int:
    """Index of the region that is the k-th one beside the target."""
    found, f, camera = r.measured.found, r.features, r.measured.scene.sensor.camera
    X_ray = camera.unproject(found.centroid_uv, found.mean_depth) @ r.frame.R_ray_cam.T
    along, across = r.frame.inertia_axes()
    b = f.brothers[k]
    there = X_ray[HIGHEST] + b[ALONG] * along + b[ACROSS] * across + b[OUT] * f.mean_normal
    return int(np.argmin(np.linalg.norm(X_ray - there, axis=1)))


def relation_table(r: Recognised, k: int) -> str:
    """The relation vector, measured and of the representative attitude's regions under the half turn that fits."""
    rows = [relation_row("measured", np.asarray(r.features.brothers[k]))]
    for model in r.with_brother:
        b = model.brothers[0].copy()
        if b[:2] @ r.features.brothers[k][:2] < 0:
            b[:2] = -b[:2]
        rows.append(relation_row(f"model, from face {model.faces}", b))
    head = ["", "along [mm]", "across [mm]", "out [mm]", "distance [mm]", "size [mm²]", "between normals [°]"]
    return table(head, rows, numeric=tuple(range(1, 7)))


def relation_row(name: str, b: np.ndarray) -> list[str]:
    angle = float(np.degrees(np.arccos(np.clip(b[FACING], -1.0, 1.0))))
    values = [b[ALONG], b[ACROSS], b[OUT], np.linalg.norm(b[:3])]
    return [name, *(number(v) for v in values), number(np.exp(2.0 * b[SIZE]), 0), number(angle, 0)]


def colour_of(name: str) -> Rgb:
    """Of the rotations a and b."""
    return {"a": SKY, "b": GREEN}[name]
