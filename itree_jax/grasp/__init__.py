"""Grasps without collision, from the CAD model and the world model (Ikeuchi 1987, figure 6e).

| name | what it is |
|---|---|
| `Gripper`, `load_gripper` | a parallel jaw or a suction cup, from TOML |
| `grasp_table`, `grasp_tables` | part + gripper -> candidates, offline |
| `find_grasps` | world + candidates -> `Grasps`, best first, with the reason for every part that has none |
| `grasps_to_json`, `grasps_document`, `write_grasps` | grasps of scenes -> JSON (`grasps.schema.json`) |
"""

from itree_jax.grasp.candidate import Candidate as Candidate
from itree_jax.grasp.candidates import GraspTable as GraspTable
from itree_jax.grasp.candidates import grasp_table as grasp_table
from itree_jax.grasp.gripper import Gripper as Gripper
from itree_jax.grasp.gripper import load_gripper as load_gripper
from itree_jax.grasp.plan import Grasp as Grasp
from itree_jax.grasp.plan import Grasps as Grasps
from itree_jax.grasp.plan import find_grasps as find_grasps
from itree_jax.grasp.plan import grasp_tables as grasp_tables
from itree_jax.grasp.results import grasps_document as grasps_document
from itree_jax.grasp.results import grasps_to_json as grasps_to_json
from itree_jax.grasp.results import write_grasps as write_grasps
