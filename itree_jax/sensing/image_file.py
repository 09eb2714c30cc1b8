"""Images on disk -> linear float intensity, and back."""

import warnings
from pathlib import Path

import cv2
import numpy as np
from itree_kernels.camera import Camera
from itree_kernels.errors import ItreeError, ItreeWarning
from itree_kernels.npy_file import parse_npy
from jaxtyping import Float, Num, UInt

from itree_jax.input_check import BRIGHTEST

IMAGE_SUFFIXES = (".png", ".tif", ".tiff", ".npy")
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def decoded(path: Path) -> Num[np.ndarray, "..."]:
    """What the file holds, colour in OpenCV's order (blue first). Raises `ItreeError` if it cannot be read."""
    image = _decoded(path)
    if image.size == 0:
        raise ItreeError(f"{path}: the image has no pixel, its shape is {image.shape}")
    return image


def _decoded(path: Path) -> Num[np.ndarray, "..."]:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ItreeError(f"{path}: the image cannot be read ({error.strerror})") from error
    if not content:
        raise ItreeError(f"{path}: the image file is empty; was it written to its end?")
    if content.startswith(PNG_SIGNATURE) and not chunks_fit(content):
        raise ItreeError(f"{path}: not an image that is whole: it is cut short, or damaged")
    try:
        if path.suffix == ".npy":
            return parse_npy(content, str(path))
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ItreeError(f"{path}: the image cannot be read ({error})") from error
    if image is None:
        raise ItreeError(f"{path}: not an image, cut short, or a kind that is not understood; use 8- or 16-bit PNG")
    return image


def chunks_fit(png: bytes) -> bool:
    """Whether the chunks of a PNG end where the file does: OpenCV reserves what a chunk says that it has, 4 GB at most,
    before it finds that the file is shorter."""
    at = len(PNG_SIGNATURE)
    while at + 12 <= len(png):  # length, name, ..., checksum
        end = at + 12 + int.from_bytes(png[at : at + 4], "big")
        if png[at + 4 : at + 8] == b"IEND":
            return end <= len(png)
        at = end
    return False


def read_image(path: Path) -> Num[np.ndarray, "height width"]:
    """A single-channel image as stored: uint8, uint16 or float. Three equal channels count as one.

    Raises `ItreeError` if it cannot be read or has colour.
    """
    image = decoded(path)
    if image.ndim == 3:
        colours = image[..., :3]
        if (colours != colours[..., :1]).any():
            raise ItreeError(
                f"{path}: the image has colour, but photometric stereo needs one linear intensity per pixel; luma is "
                "gamma-coded and hides a saturated channel: store one channel (raw green or a monochrome camera)"
            )
        image = colours[..., 0]
    if image.ndim != 2:
        raise ItreeError(f"{path}: an image of height x width is expected, its shape is {image.shape}")
    return image


def read_intensity(path: Path, bit_depth: int | None = None, gamma: float = 1.0) -> Float[np.ndarray, "height width"]:
    """Linear float32 intensity, 1.0 = full scale.

    Full scale of an integer image is 2^bit_depth - 1 (default: its type's), of a float image 1.0. `gamma` undoes a
    response stored = intensity^(1/gamma). Raises `ItreeError` if values exceed the stated bit depth or are not finite.
    """
    return linear(read_image(path), path, bit_depth, gamma)


def linear(
    image: Num[np.ndarray, "*shape"], path: Path, bit_depth: int | None, gamma: float
) -> Float[np.ndarray, "*shape"]:
    """Stored values -> linear float32 intensity, as `read_intensity` says; `path` is for its errors."""
    if image.dtype.kind == "f":
        intensity = image.astype(np.float64)
        highest = np.abs(intensity, where=np.isfinite(intensity), out=np.zeros(image.shape)).max(initial=0.0)
        if highest > BRIGHTEST:
            raise ItreeError(
                f"{path}: values go up to {highest:.4g}, but 1.0 is full scale of an image in floats; divide it by the "
                "camera's full scale"
            )
    elif image.dtype in (np.uint8, np.uint16):
        full_scale = 2 ** (bit_depth or 8 * image.dtype.itemsize) - 1
        if image.max(initial=0) > full_scale:
            raise ItreeError(f"{path}: the value {image.max()} is above full scale of {bit_depth} bits ({full_scale})")
        intensity = image / float(full_scale)
    else:
        raise ItreeError(f"{path}: images must be 8-bit, 16-bit or float, this one is {image.dtype}")
    if not np.isfinite(intensity).all():
        raise ItreeError(f"{path}: the image has values that are not finite")
    if gamma != 1.0:
        intensity = np.maximum(intensity, 0.0) ** gamma
    return intensity.astype(np.float32)


def warn_of_gamma(path: Path, bit_depth: int | None, gamma: float) -> None:
    """An `ItreeWarning` if an image is stored in 8 bits and the sensor says nothing of its response."""
    if gamma == 1.0 and bit_depth is None and decoded(path).dtype == np.uint8:
        warnings.warn(
            f"{path.parent}: the images are stored in 8 bits, as cameras store gamma-coded ones, and are taken as "
            "linear. Gamma bends every normal: take linear images of 10 bits or more, or say in the sensor JSON what "
            'these are: "bit_depth": 8 if linear, else "response": {"gamma": 2.2}.',
            ItreeWarning,
            stacklevel=3,
        )


def undistorted(
    image: Float[np.ndarray, "height width"], camera: Camera, distortion: tuple[float, ...], nearest: bool = False
) -> Float[np.ndarray, "height width"]:
    """The image of the ideal camera with the same matrix; 0 where the lens shows nothing.

    Depth maps are taken at the `nearest` pixel: between a part and the floor there is no depth to interpolate.
    """
    if not any(distortion):
        return image
    K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    u, v = cv2.initUndistortRectifyMap(
        K, np.array(distortion), np.eye(3), K, (camera.width, camera.height), cv2.CV_32FC1
    )
    interpolation = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    return cv2.remap(image, u, v, interpolation, borderMode=cv2.BORDER_CONSTANT, borderValue=0)


def png_bytes(image: UInt[np.ndarray, "height width *channels"]) -> bytes:
    """PNG file content of an 8- or 16-bit image; three channels are red, green, blue."""
    ok, content = cv2.imencode(".png", image[..., ::-1] if image.ndim == 3 else image)
    if not ok:
        raise ItreeError(f"an image of shape {image.shape} and type {image.dtype} cannot be stored as PNG")
    return content.tobytes()
