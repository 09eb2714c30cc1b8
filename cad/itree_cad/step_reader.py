"""STEP -> GLB by OpenCascade, in a process of its own: on some damaged files OpenCascade does not refuse but crash."""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from itree_kernels.errors import ItreeError

CHORD = 0.05  # [mm], largest distance between a surface and its triangles
TURN = 0.07  # [rad], largest angle between neighbouring facets: 4 degrees
PROGRAM = f"""
import sys, cascadio
glb = cascadio.load(
    sys.stdin.buffer.read(), tol_linear={CHORD}, tol_angular={TURN}, include_brep=True, merge_primitives=True,
    use_parallel=False,
)
with open(sys.argv[1], "wb") as file:
    file.write(glb or b"")
"""


def step_to_glb(data: bytes, where: str) -> bytes:
    """The shapes of a STEP file as GLB [m]. Raises ItreeError, naming `where`, if OpenCascade cannot read them."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "shapes.glb"
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, out], input=data, capture_output=True, check=False,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        )  # fmt: skip
        glb = out.read_bytes() if out.is_file() else b""
    if glb:
        return glb
    reason = _complaint(done.stdout + done.stderr) or "it has no shape in it, or is damaged"
    if done.returncode < 0:
        reason = f"it is damaged so that OpenCascade crashes, signal {-done.returncode}"
    raise ItreeError(f"{where} cannot be read as STEP: {reason}")


def _complaint(printed: bytes) -> str | None:
    """What OpenCascade found wrong, without its colours and asterisks."""
    text = re.sub(r"\x1b\[[\d;]*m", "", printed.decode("latin-1"))
    found = re.search(r"\*{3,4} ERR StepFile : Undefined Parsing: (.*?)\s*\*{3,4}", text)
    return found.group(1) if found else None
