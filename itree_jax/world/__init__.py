"""The world model that recognition fills (Ikeuchi 1987, sec. 3.2).

| name | what it is |
|---|---|
| `World`, `PlacedPart`, `Prism`, `BinWalls` | what lies where, in the camera's frame |
| `world_model` | answers + depth + bin -> `World` |
| `world_meshes`, `to_scene` | `World` -> triangle meshes, and a scene for GLB and PLY files |
| `load_bin` | the bin that a scene folder tells of |
"""

from itree_jax.world.bin_walls import BinWalls as BinWalls
from itree_jax.world.bin_walls import load_bin as load_bin
from itree_jax.world.meshes import to_scene as to_scene
from itree_jax.world.meshes import world_meshes as world_meshes
from itree_jax.world.model import PlacedPart as PlacedPart
from itree_jax.world.model import World as World
from itree_jax.world.model import world_model as world_model
from itree_jax.world.prism import Prism as Prism
