"""The 3-D view in a page: bodies as data for `world3d.js`, with legend, words and a still picture.

Our own few lines of WebGL and no library: one would add 0.7 MB to every page, and trimesh's ready-made viewer has no
legend, names nothing that is pointed at, is white in a dark page, and takes the page's scrolling away on a phone.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from itree_jax.report.body import KIND_NAMES, NEARER, Body, Stage
from itree_jax.report.body_picture import body_picture
from itree_jax.report.markup import figure, image, swatches, text
from itree_jax.report.mesh_packing import drawn_solid, packed
from itree_jax.report.palette import css, ink_on

SCRIPT = Path(__file__).with_name("world3d.js")
MOST_TRIANGLES = 40_000  # on a page, all different solids together: about 1 MB
LEAST_TRIANGLES = 400  # of a solid, however many there are
EDGE_SHADE = 0.35  # of a body's colour: its edges
BUTTONS = (("home", "Start"), ("above", "From above"), ("nearer", "+"), ("farther", "\N{MINUS SIGN}"))
HOW = (
    "Drag to turn it (on a phone sideways, or with two fingers), arrow keys too; pinch, + and \N{MINUS SIGN}, or Ctrl "
    "and the wheel to zoom. Point at a thing, or tap it, to read what it is."
)


def world_figure(bodies: list[Body], stage: Stage, title: str, caption: str) -> str:
    """Bodies that turn with the mouse, by touch and keys; without script or WebGL, and on paper, a picture of them.

    `title` is plain text, `caption` HTML.
    """
    meshes = list({id(b.mesh): b.mesh for b in bodies}.values())
    most = max(MOST_TRIANGLES // max(len(meshes), 1), LEAST_TRIANGLES)
    solids = [drawn_solid(mesh, most) for mesh in meshes]
    index = {id(mesh): k for k, mesh in enumerate(meshes)}
    still = body_picture(bodies, [solids[index[id(b.mesh)]] for b in bodies], stage)
    data = json.dumps(
        {"up": rounded(stage.up), "toward": rounded(stage.toward), "centre": rounded(stage.centre),
         "radius": round(stage.radius, 3), "zoom": NEARER, "meshes": [packed(s) for s in solids],
         "bodies": [body_data(b, index[id(b.mesh)]) for b in bodies]},
        separators=(",", ":"), allow_nan=False,
    ).replace("<", "\\u003c")  # fmt: skip
    buttons = "".join(f'<button type="button" name="{name}">{text(words)}</button>' for name, words in BUTTONS)
    content = (
        f'<div class="world3d"><div class="stage">{image(still, f"{title}: {len(bodies)} bodies", css_class="still")}'
        f'<canvas tabindex="0" aria-label="{text(title)}, to be turned"></canvas></div>'
        f'<p class="controls">{buttons}{switches(bodies)}</p><p class="told"><output>{HOW}</output></p>'
        f'<script type="application/json">{data}</script></div>'
    )
    return figure(content, title, caption, part_legend(bodies))


def world_script() -> str:
    """To be put once at the end of a page that has such figures."""
    return f"<script>\n{SCRIPT.read_text(encoding='utf-8')}</script>"


def switches(bodies: list[Body]) -> str:
    """A box for each kind there is, to hide and show it."""
    there = [kind for kind in KIND_NAMES if any(b.kind == kind for b in bodies)]
    return "".join(
        f'<label><input type="checkbox" name="{kind}" checked>{text(KIND_NAMES[kind])}</label>' for kind in there
    )


def part_legend(bodies: list[Body]) -> str:
    """Colours of the parts, and of what is no part."""
    parts = [(css(b.colour), b.name) for b in bodies if b.kind == "part"]
    prisms = [(css(b.colour), KIND_NAMES["prism"]) for b in bodies if b.kind == "prism"]
    return swatches([*parts, *prisms[:1]])


def body_data(body: Body, mesh: int) -> dict[str, Any]:
    """One body as `world3d.js` reads it; its matrix column by column, as graphics wants it."""
    colour = np.array(body.colour) / 255.0
    middle = body.corners_cam.mean(axis=0)
    return {
        "kind": body.kind, "name": body.name, "note": body.note, "label": body.label, "link": body.link, "mesh": mesh,
        "T": rounded(body.T_cam_body.T.ravel(), 6), "centre": rounded(middle), "colour": rounded(colour),
        "edge": rounded(EDGE_SHADE * colour), "alpha": body.opacity, "css": css(body.colour),
        "ink": css(ink_on(body.colour)),
    }  # fmt: skip


def rounded(values: np.ndarray, digits: int = 4) -> list[float]:
    return [round(float(v), digits) for v in values]
