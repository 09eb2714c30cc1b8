"""Reports that people read: one self-contained HTML page for each scene, an index of many, a page for each tree.

| name | what it is |
|---|---|
| `write_scene_report` | scene + detections + trees -> one page |
| `report_scene` | the same, and the scene's entry for the index |
| `write_index`, `IndexEntry` | the index of many scenes, failures first |
| `write_world` | a world model -> GLB and PLY |
| `true_poses` | what a scene's folder tells of the truth, for a report that compares |
| `write_tree_page` | a compiled tree -> one page |
| `write_svg_tree` | the tree alone -> one SVG file |
| `svg_tree` | a tree, and the way through it, as SVG for a page |
"""

from itree_jax.report.index_page import IndexEntry as IndexEntry
from itree_jax.report.index_page import report_scene as report_scene
from itree_jax.report.index_page import write_index as write_index
from itree_jax.report.scene_page import write_scene_report as write_scene_report
from itree_jax.report.svg_file import write_svg_tree as write_svg_tree
from itree_jax.report.svg_tree import svg_tree as svg_tree
from itree_jax.report.tree_page import write_tree_page as write_tree_page
from itree_jax.report.truth_view import true_poses as true_poses
from itree_jax.report.world_files import write_world as write_world
