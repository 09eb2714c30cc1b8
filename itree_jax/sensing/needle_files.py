"""A needle map as files that other programs read."""

import io
from pathlib import Path

import numpy as np
from itree_kernels.whole_files import write_whole
from jaxtyping import Bool, Float, UInt16

from itree_jax.sensing.image_file import png_bytes
from itree_jax.sensing.needle import NeedleMap

FULL_SCALE = 65535


def write_needle_map(
    folder: Path, needle: NeedleMap, mask: Bool[np.ndarray, "height width"]
) -> Bool[np.ndarray, "height width"]:
    """Write a needle map into an existing folder, and return where normals are (interpretable, inside `mask`).

    - `normals.npy` float32 [height, width, 3]: unit, camera frame (x right, y down, z forward), NaN where none
    - `albedo.npy` float32 [height, width]: of full scale under a light of intensity 1, NaN where none
    - `uncertainty.npy` float32 [height, width]: standard deviation [rad] of the normal's direction, from the sensor's
      noise and the model's error together, NaN where none
    - `mask.png` 8 bit: 255 where there is a normal
    - `normals.png` 16 bit: red green blue = x y z of the camera frame, 0..65535 for -1..1; 0 0 0 where none
    """
    there = np.asarray(needle.interpretable) & mask
    normals = _where(there[..., None], needle.normals)
    unit = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    files = {
        "normals.npy": _npy_bytes(unit),
        "albedo.npy": _npy_bytes(_where(there, needle.albedo)),
        "uncertainty.npy": _npy_bytes(_where(there, uncertainty(needle))),
        "mask.png": png_bytes(np.where(there, 255, 0).astype(np.uint8)),
        "normals.png": png_bytes(encoded_normals(normals)),
    }
    for name, content in files.items():
        write_whole(folder / name, content)
    return there


def uncertainty(needle: NeedleMap) -> Float[np.ndarray, "height width"]:
    """Standard deviation [rad] of each normal's direction: noise, and what Lambert's law and direct light leave out."""
    return np.hypot(np.asarray(needle.normal_std), np.asarray(needle.normal_bias))


def encoded_normals(normals: Float[np.ndarray, "height width 3"]) -> UInt16[np.ndarray, "height width 3"]:
    """0..65535 for -1..1; three zeros, which are no unit vector, for NaN."""
    level = np.round((np.asarray(normals, np.float64) + 1.0) / 2.0 * FULL_SCALE)
    return np.nan_to_num(np.clip(level, 0, FULL_SCALE)).astype(np.uint16)


def decoded_normals(encoded: UInt16[np.ndarray, "height width 3"]) -> Float[np.ndarray, "height width 3"]:
    """Unit normals from `encoded_normals`, NaN where none."""
    normals = encoded / FULL_SCALE * 2.0 - 1.0
    normals[(encoded == 0).all(-1)] = np.nan
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _npy_bytes(values: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, values)
    return out.getvalue()


def _where(there: np.ndarray, values: object) -> np.ndarray:
    return np.where(there, np.asarray(values, np.float32), np.float32(np.nan))
