"""The geometrical modeler: CAD and mesh files, and solids in CSG, as parts whose triangles know their face.

Doors: `load.load_part`, `bundled.bundled_part`, `part_file.read_part_file`; what they give: `part.Part`.
"""
