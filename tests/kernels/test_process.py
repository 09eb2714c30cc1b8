"""A process that uses the kernels starts light, says nothing, and ends."""

import subprocess
import sys
import textwrap

PROGRAM = textwrap.dedent("""
    import sys
    import itree_kernels, itree_kernels.errors
    heavy = {"warp", "jax", "numpy", "trimesh"} & set(sys.modules)
    assert not heavy, heavy

    import os
    os.cpu_count = lambda: 2
    import numpy as np
    from itree_kernels.apparent import cast_apparent_shapes
    from itree_kernels.camera import Camera
    from itree_kernels.instances import Material
    from itree_kernels.lit_scene import render_scene
    from itree_kernels.mesh import ray_mesh
    import warp
    level = warp.config.log_level

    corners = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
    mesh = ray_mesh(corners, np.array([[0, 2, 1], [0, 3, 2]]), np.zeros(2, int), device="cpu")
    camera = Camera("orthographic", 8.0, 8.0, 63.7, 63.7, 128, 128)
    R, t, light = np.eye(3)[None], np.array([[0, 0, 50.0]]), np.array([[0, 0, -1.0]])
    assert (cast_apparent_shapes(mesh, R, t, camera, light, 0.7).face == 0).all()
    scene = render_scene([mesh], [0], R, t, camera, light, np.ones(1), Material(0.5))
    assert (scene.images == 0.5).all()
    assert warp.config.log_level == level  # the user's setting is as it was
""")


def test_a_process_that_renders_is_quiet_and_ends():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
