"""The world model and the needle map in a live viewer, in a browser: `itree view` (extra `view`: viser)."""

from contextlib import redirect_stdout
from io import StringIO
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError
from jaxtyping import Float, UInt8

from itree_jax.report.body import KIND_NAMES, Body, Stage
from itree_jax.report.grasp_bodies import grasp_bodies
from itree_jax.report.markup import number
from itree_jax.report.mesh_packing import drawn_solid
from itree_jax.report.scene_pictures import Picture, needle_colours
from itree_jax.report.scene_view import SceneView
from itree_jax.report.world_bodies import world_bodies
from itree_jax.report.world_files import OPACITY

if TYPE_CHECKING:
    import viser

METRES = 1e-3  # per mm: the viewer's near and far limits suit a room in metres
MOST_POINTS = 120_000  # of the needle map: about 2 MB, drawn at once by any graphics
POINT_SIZE = 0.6  # of the distance between points on a plane that faces the camera
LINE_WIDTH = 2.0  # [px]
VIEWED_FROM = 1.6  # radii of the scene away


class LiveView:
    """A running server with one scene; close it, or use it in a `with` block."""

    def __init__(self, view: SceneView, host: str = "127.0.0.1", port: int = 8080) -> None:
        """Raises ItreeError when viser isn't installed. A port that is taken gives way to the next free one."""
        self._server = _server(host, port)
        bodies, stage = world_bodies(view.world)
        if view.grasps is not None:
            bodies += grasp_bodies(view.grasps)
        nodes = [_add_body(self._server, body, stage) for body in bodies]
        self.nodes = (*nodes, _add_needles(self._server, view, stage))  # names, such as "/part/pose 0"
        _add_switches(self._server, [*dict.fromkeys(b.kind for b in bodies), "needles"])
        _look(self._server, stage)
        self.url = f"http://{host}:{self._server.get_port()}"

    def close(self) -> None:
        with redirect_stdout(StringIO()):
            self._server.stop()

    def __enter__(self) -> "LiveView":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def check_viewer() -> None:
    """Raises ItreeError when viser isn't installed: asked before the work, not after it."""
    try:
        import viser  # noqa: F401
    except ImportError as error:
        raise ItreeError(
            f"the live viewer needs the package viser ({error}): pip install 'itree-jax[view]'. The pages of "
            "`itree recognize --report` have a 3-D view that needs nothing."
        ) from error


def _server(host: str, port: int) -> "viser.ViserServer":
    check_viewer()
    import viser

    with redirect_stdout(StringIO()):  # it greets there, whatever `verbose` says
        return viser.ViserServer(host, port, label="itree-jax", verbose=False)


def _add_body(server: "viser.ViserServer", body: Body, stage: Stage) -> str:
    """Under the node of its kind, so that one switch hides all of a kind. Returns its name."""
    X = METRES * (body.mesh.vertices @ body.T_cam_body[:3, :3].T + body.T_cam_body[:3, 3] - stage.centre)
    name, opacity = f"/{body.kind}/{body.name}", OPACITY.get(body.kind, 0.0)
    if opacity:
        server.scene.add_mesh_simple(
            name, X, np.asarray(body.mesh.faces), color=body.colour, opacity=opacity if opacity < 1.0 else None,
            flat_shading=True, side="double" if opacity < 1.0 else "front",
        )
    else:
        solid = drawn_solid(body.mesh, len(body.mesh.faces))
        X = METRES * (solid.vertices @ body.T_cam_body[:3, :3].T + body.T_cam_body[:3, 3] - stage.centre)
        ends = X[solid.edges]
        server.scene.add_line_segments(
            name, ends, np.array(body.colour), thickness=LINE_WIDTH, thickness_units="screen"
        )
    if body.label:
        score = "" if body.score is None else f": {number(body.score, 2)}"
        place = METRES * (body.corners_cam.mean(axis=0) - stage.centre)
        server.scene.add_label(f"{name}/label", f"{body.label}{score}", position=place, anchor="bottom-center")
    return name


def _add_needles(server: "viser.ViserServer", view: SceneView, stage: Stage) -> str:
    """Where depth is known, a point for each pixel in its normal's colour; else the needle map as a picture on the
    plane at the working distance. Returns its name."""
    camera, colours = view.scene.sensor.camera, needle_colours(view.needle)
    if view.scene.depth is None:
        return _add_picture(server, colours, camera, view.scene.sensor.working_distance, stage)
    X_cam, shown, pitch = surface_points(view.scene.depth, colours, camera)
    return server.scene.add_point_cloud(
        "/needles/points", (METRES * (X_cam - stage.centre)).astype(np.float32), shown,
        point_size=METRES * POINT_SIZE * pitch, precision="float32", point_shading="flat",
    ).name


def surface_points(
    depth: Float[np.ndarray, "h w"], colours: Picture, camera: Camera
) -> tuple[Float[np.ndarray, "points 3"], UInt8[np.ndarray, "points 3"], float]:
    """Points [mm] in the camera's frame with their colours, every few pixels, and the distance between them [mm]."""
    step = max(1, int(np.ceil(np.sqrt((depth > 0).sum() / MOST_POINTS))))
    v, u = np.nonzero(depth[::step, ::step] > 0)
    v, u = v * step, u * step
    z = depth[v, u].astype(float)
    middle = float(np.median(z)) if len(z) else 1.0
    return camera.unproject(np.stack([u, v], axis=-1).astype(float), z), colours[v, u], step * camera.mm_per_px(middle)


def _add_picture(
    server: "viser.ViserServer", picture: Picture, camera: Camera, distance: float, stage: Stage
) -> str:
    size = camera.mm_per_px(distance) * np.array([camera.width, camera.height])
    centre = camera.unproject(np.array([(camera.width - 1) / 2, (camera.height - 1) / 2]), np.array(distance))
    return server.scene.add_image(
        "/needles/picture", picture, METRES * float(size[0]), METRES * float(size[1]),
        position=METRES * (centre - stage.centre),
    ).name


def _add_switches(server: "viser.ViserServer", kinds: list[str]) -> None:
    """A box for each kind. Parents are made here: viser hides children with them."""
    names = KIND_NAMES | {"needles": "needle map"}
    for kind in kinds:
        parent = server.scene.add_frame(f"/{kind}", show_axes=False)
        box = server.gui.add_checkbox(names[kind], True)

        def switched(event: Any, parent: Any = parent, box: Any = box) -> None:
            parent.visible = box.value

        box.on_update(switched)


def _look(server: "viser.ViserServer", stage: Stage) -> None:
    """As the page's 3-D view does at first."""
    server.scene.set_up_direction(stage.up)
    server.initial_camera.position = METRES * VIEWED_FROM * stage.radius * stage.toward
    server.initial_camera.look_at = np.zeros(3)
    server.initial_camera.up = stage.up
