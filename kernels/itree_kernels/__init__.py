"""Ray casting for itree-jax, on NVIDIA Warp: the same kernels on the CPU and on CUDA.

| module | what it gives |
|---|---|
| `camera` | `Camera`: orthographic or pinhole |
| `mesh` | `RayMesh`, `ray_mesh`: triangles that rays can be cast at |
| `apparent` | `cast_apparent_shapes`: what a sensor sees of one part in many views |
| `lit_scene` | `render_scene`: images of many parts in a bin under each light |
| `bin` | `bin_mesh`: an open box |
| `instances` | `Material`: the reflectance of each instance |
| `noise` | `sensor_noise`: shot noise, read noise, quantisation |
| `correspond` | `correspondences`: what pose hypotheses predict at their pixels |
| `errors` | `ItreeError`: the one exception a user can meet |

Nothing is imported here: Warp starts when a module with a kernel is imported by its own name.
"""
