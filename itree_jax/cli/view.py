"""`itree view`: one scene in a live viewer."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from itree_kernels.errors import ItreeError

from itree_jax.cli.runtime import start_jax
from itree_jax.cli.terminal import progress, say

WAKE = 0.5  # [s] between looks at the keyboard


@dataclass(frozen=True)
class View:
    """Recognise one scene and show it in a live 3-D viewer in the browser (extra `view`)."""

    scene: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
    """One scene folder."""
    trees: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="TREE...")]
    """One or more tree files."""
    depth: Literal["auto", "file", "stereo", "none"] = "auto"
    """Where depth comes from, as of `itree recognize`."""
    host: str = "127.0.0.1"
    """Address to serve at; 0.0.0.0 lets other computers look."""
    port: int = 8080
    """Port to serve at; if it is taken, the next free one."""
    quiet: bool = False
    """Show nothing but warnings and errors (and the address)."""

    def run(self) -> None:
        """Serves until it is interrupted. Raises ItreeError about the scene or a tree, or when viser is missing."""
        if not self.trees:
            raise ItreeError("no TREE is given; make one with `itree compile MODEL --sensor SENSOR -o TREE`")
        from itree_jax.report.live_view import LiveView, check_viewer

        check_viewer()
        with progress(self.quiet) as tell:
            tell("loading", 0.0)
            start_jax()
            from itree_jax.cli.recognize import check_objects
            from itree_jax.cli.scene_answer import answer
            from itree_jax.prepared import prepare
            from itree_jax.report.scene_view import scene_view
            from itree_jax.sensing.scene_folder import scene_folders
            from itree_jax.tree.tree_file import load_tree

            folders = scene_folders(self.scene)
            if len(folders) != 1:
                raise ItreeError(f"{self.scene} holds {len(folders)} scenes; give one of them, such as {folders[0]}")
            prepared = [prepare(load_tree(path)) for path in self.trees]
            check_objects(prepared)
            tell("recognising", 0.2)
            scene, fitting, found = answer(folders[0], prepared, {}, self.quiet, self.depth)
            view = scene_view(scene, found, [p.tree for p in fitting])
        with LiveView(view, self.host, self.port) as live:
            say(f"{live.url} shows the scene; Ctrl+C ends it", quiet=False)
            while True:
                time.sleep(WAKE)
