"""The tutorial's part as a STEP file. Needs build123d, in an environment of its own: the project does not use it.

    pip install build123d && python experiments/figures/tutorial_part.py [FILE]

A holder 60 x 40 x 38: a base with a hole out of its middle, and an upright with one corner cut off, so that no turn
carries it into itself. The file's header tells the time of writing; the geometry is the same every time.
"""

import sys

from build123d import Align, Box, BuildPart, Cylinder, Locations, Mode, export_step

CORNER = (Align.MIN, Align.MIN, Align.MIN)


def main(path: str) -> None:
    with BuildPart() as holder:
        Box(60, 40, 12, align=CORNER)
        Box(60, 10, 38, align=CORNER)
        with Locations((42, 26, 0)):
            Cylinder(7, 12, align=(Align.CENTER, Align.CENTER, Align.MIN), mode=Mode.SUBTRACT)
        with Locations((60, 0, 38)):
            Box(24, 10, 16, align=(Align.MAX, Align.MIN, Align.MAX), mode=Mode.SUBTRACT)
    assert holder.part is not None
    holder.part.label = "holder"
    export_step(holder.part, path)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "docs/tutorial/holder.step")
