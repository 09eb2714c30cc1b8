"""Pictures of what was measured: lit images, needle map, depth map, regions. All are RGB, 8 bits, sRGB-like."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from itree_jax.report.palette import GREY, Rgb, cycle, ink_on
from itree_jax.sensing.needle import NeedleMap

Picture = UInt8[np.ndarray, "_ _ 3"]

DISPLAY_GAMMA = 2.2  # screens expect it; the images are linear
WHITE_PERCENTILE = 99.5  # brighter pixels (highlights) are shown white
NEEDLE_STEP = 14  # [px] of a picture 640 px wide: one needle in each square of this side
NEEDLE_LENGTH = 1.6  # of the step: a needle lying in the image plane
NOTHING = 40  # grey value where nothing was measured
DEEP = 0.9  # of the greatest distance from a mask's outside
VIRIDIS = cv2.COLORMAP_VIRIDIS


def white_level(images: Float[np.ndarray, "lights h w"]) -> float:
    """Intensity (1.0 = full scale) that is shown white."""
    return max(float(np.percentile(images, WHITE_PERCENTILE)), 1e-3)


def displayed(image: Float[np.ndarray, "h w"], white: float) -> Picture:
    """A linear image as a screen shows it."""
    shown = np.clip(np.asarray(image, float) / white, 0.0, 1.0) ** (1.0 / DISPLAY_GAMMA)
    return np.repeat(np.round(255.0 * shown).astype(np.uint8)[..., None], 3, axis=2)


def scaled(picture: UInt8[np.ndarray, "h w c"], scale: float) -> UInt8[np.ndarray, "h2 w2 c"]:
    """Pixel (u, v) goes to ((u + 0.5) scale - 0.5, (v + 0.5) scale - 0.5), as `scaled_uv` says."""
    height, width = picture.shape[:2]
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)


def scaled_uv(uv: Float[np.ndarray, "*n 2"], scale: float) -> Float[np.ndarray, "*n 2"]:
    return (np.asarray(uv, float) + 0.5) * scale - 0.5


def normal_colours(normals: Float[np.ndarray, "h w 3"]) -> Picture:
    """The usual normal-map colours: red = right, green = up, blue = toward the viewer, 0..255 for -1..1.

    The camera's y points down and its z away, so both change sign.
    """
    toward = np.asarray(normals, float) * np.array([1.0, -1.0, -1.0])
    return np.clip(np.round(127.5 * (toward + 1.0)), 0, 255).astype(np.uint8)


def needle_colours(needle: NeedleMap) -> Picture:
    """The needle map as colours, dark where it can't be interpreted."""
    picture = normal_colours(np.asarray(needle.normals))
    picture[~np.asarray(needle.interpretable)] = NOTHING
    return picture


def normal_legend(side: int = 88) -> UInt8[np.ndarray, "h w 4"]:
    """A ball in the colours of the needle map, transparent around it."""
    x, y = np.meshgrid(*[(np.arange(side) - (side - 1) / 2) / (side / 2)] * 2)
    inside = x**2 + y**2 <= 1.0
    z = -np.sqrt(np.where(inside, 1.0 - x**2 - y**2, 0.0))
    alpha = np.where(inside, 255, 0).astype(np.uint8)
    return np.dstack([normal_colours(np.stack([x, y, z], axis=-1)), alpha])


def needle_lines(background: Picture, needle: NeedleMap, scale: float) -> Picture:
    """Needles on a dim background: each starts at its dot and points where the surface faces, foreshortened."""
    normals, known = np.asarray(needle.normals, float), np.asarray(needle.interpretable)
    step = max(4, round(NEEDLE_STEP * known.shape[1] / 640))
    # dim, so that bright needles stand out on it
    picture = (scaled(background, scale) * 0.45).astype(np.uint8)
    width = max(1, round(picture.shape[1] / 640))
    v, u = np.mgrid[step // 2 : known.shape[0] : step, step // 2 : known.shape[1] : step].reshape(2, -1)
    keep = known[v, u]
    base = np.stack([u[keep], v[keep]], axis=-1).astype(float)
    tip = base + NEEDLE_LENGTH * step * normals[v[keep], u[keep], :2]
    for a, b in zip(scaled_uv(base, scale), scaled_uv(tip, scale), strict=True):
        start, end = subpixel(a), subpixel(b)
        cv2.line(picture, start, end, (255, 214, 92), width, cv2.LINE_AA, SUBPIXEL_BITS)
        cv2.circle(picture, start, width * 2**SUBPIXEL_BITS, (255, 255, 255), -1, cv2.LINE_AA, SUBPIXEL_BITS)
    return picture


SUBPIXEL_BITS = 4  # OpenCV draws at 1/16 px


def subpixel(uv: Float[np.ndarray, "2"]) -> tuple[int, int]:
    """A point as OpenCV's drawing functions take it with `SUBPIXEL_BITS`."""
    return round(float(uv[0]) * 2**SUBPIXEL_BITS), round(float(uv[1]) * 2**SUBPIXEL_BITS)


def depth_range(depth: Float[np.ndarray, "h w"]) -> tuple[float, float]:
    """Nearest and farthest depth [mm] on the colour bar: the middle 99 % of what is known."""
    known = depth[depth > 0]
    if known.size == 0:
        return 0.0, 1.0
    near, far = (float(z) for z in np.percentile(known, (0.5, 99.5)))
    return near, max(far, near + 1e-3)


def depth_colours(depth: Float[np.ndarray, "h w"], near: float, far: float) -> Picture:
    """Near is bright, far is dark (viridis); dark grey where there is no depth."""
    picture = viridis((far - np.asarray(depth, float)) / (far - near))
    picture[~(depth > 0)] = NOTHING
    return picture


def viridis(level: Float[np.ndarray, "h w"]) -> Picture:
    """Colours of levels 0 (dark) to 1 (bright): their lightness rises evenly, so that everybody can order them."""
    grey = np.clip(np.round(255.0 * level), 0, 255).astype(np.uint8)
    return cv2.cvtColor(cv2.applyColorMap(grey, VIRIDIS), cv2.COLOR_BGR2RGB)


def colour_bar(stops: int = 9) -> list[Rgb]:
    """Colours of `depth_colours` from near to far, evenly spaced."""
    rgb = viridis(np.linspace(1.0, 0.0, stops)[:, None])[:, 0]
    return [(int(r), int(g), int(b)) for r, g, b in rgb]


def region_picture(
    background: Picture, labels: Int[np.ndarray, "h w"], region_pose: Int[np.ndarray, "regions"], scale: float
) -> Picture:
    """Numbered regions, in the colour of the pose (`cycle`) that explains them; grey where none does (-1)."""
    colours = [cycle(k) if k >= 0 else GREY for k in region_pose.tolist()]
    count, table = len(colours), np.array(colours, float).reshape(-1, 3)
    inside = labels >= 0
    picture = background.astype(float) * 0.6
    if count:
        picture[inside] = 0.5 * background[inside] + 0.5 * table[labels[inside]]
    picture = scaled(np.clip(picture, 0, 255).astype(np.uint8), scale)
    enlarged = cv2.resize(labels.astype(np.float32), picture.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    change = np.zeros(enlarged.shape, bool)
    change[:, 1:] |= enlarged[:, 1:] != enlarged[:, :-1]
    change[1:] |= enlarged[1:] != enlarged[:-1]
    picture[change] = 255
    for k in np.unique(labels[inside]).tolist():  # a second reading may have taken all pixels of a region
        badge(picture, scaled_uv(innermost(labels == k), scale), str(k), colours[k], 0.4 * scale)
    return picture


def innermost(mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "2"]:
    """A pixel (u, v) of a mask far from its outside, where a number is placed; of several such the most central one."""
    distance = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    vu = np.argwhere(distance >= DEEP * distance.max())
    return vu[np.argmin(((vu - vu.mean(axis=0)) ** 2).sum(axis=1))][::-1].astype(float)


def badge(picture: Picture, uv: Float[np.ndarray, "2"], label: str, colour: Rgb, size: float) -> None:
    """Draws a label in a filled box around a point of the picture, moved inside if it is near the rim."""
    thickness = max(1, round(1.6 * size))
    (width, height), _ = cv2.getTextSize(label, cv2.FONT_HERSHEY_SIMPLEX, size, thickness)
    pad = max(2, round(0.35 * height))
    half = np.array([width / 2 + pad, height / 2 + pad])
    limit = np.array(picture.shape[1::-1]) - 1.0
    centre = np.clip(np.asarray(uv, float), half + 1, np.maximum(limit - half - 1, half + 1))
    a, b = (tuple(int(x) for x in np.round(centre + s * half)) for s in (-1, 1))
    cv2.rectangle(picture, a, b, colour, -1)
    cv2.rectangle(picture, a, b, ink_on(colour), 1)
    origin = (round(centre[0] - width / 2), round(centre[1] + height / 2))
    cv2.putText(picture, label, origin, cv2.FONT_HERSHEY_SIMPLEX, size, ink_on(colour), thickness, cv2.LINE_AA)
