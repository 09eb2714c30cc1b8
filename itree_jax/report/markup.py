"""Pieces of a self-contained HTML page: text is escaped here, pictures become data URIs, nothing is fetched.

Functions that end in HTML take HTML; plain strings go through `text` first.
"""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import SupportsFloat

import cv2
import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole
from jaxtyping import UInt8

COLOURS, STYLE, FIGURES = (Path(__file__).with_name(name) for name in ("colours.css", "style.css", "figures.css"))
JPEG_QUALITY = 84  # noise of a camera image is gone, its edges are not
EN_DASH, MINUS = "\N{EN DASH}", "\N{MINUS SIGN}"
NOT_KNOWN = EN_DASH


def text(value: object) -> str:
    """Any value as escaped text."""
    return escape(str(value), quote=True)


def number(value: SupportsFloat | None, digits: int = 1) -> str:
    """With a real minus sign; a dash where it is not known, an infinity sign where nothing bounds it."""
    x = np.nan if value is None else float(value)
    if np.isnan(x):
        return NOT_KNOWN
    if np.isinf(x):
        return "∞" if x > 0 else f"{MINUS}∞"
    shown = f"{x:.{digits}f}"
    if float(shown) == 0.0:
        shown = shown.removeprefix("-")
    return shown.replace("-", MINUS)


def percent(value: SupportsFloat | None, digits: int = 1) -> str:
    """A share in percent; a dash where it is not known."""
    shown = number(None if value is None else 100.0 * float(value), digits)
    return shown if shown == NOT_KNOWN else f"{shown} %"


def count_of(count: int, one: str, many: str | None = None) -> str:
    """Such as "1 region", "2 regions"."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def data_uri(picture: UInt8[np.ndarray, "h w channels"], lossless: bool = False) -> str:
    """RGB or RGBA picture as a data URI: JPEG, or PNG if lossless or with transparency."""
    rgba = picture.shape[2] == 4
    kind = "png" if lossless or rgba else "jpeg"
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGBA2BGRA if rgba else cv2.COLOR_RGB2BGR)
    options = [cv2.IMWRITE_PNG_COMPRESSION, 9] if kind == "png" else [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    _, encoded = cv2.imencode(f".{kind}", bgr, options)
    return f"data:image/{kind};base64,{base64.b64encode(encoded.tobytes()).decode('ascii')}"


def image(picture: UInt8[np.ndarray, "h w channels"], alt: str, lossless: bool = False, css_class: str = "") -> str:
    """An <img> of the picture; `alt` is plain text."""
    height, width = picture.shape[:2]
    attribute = f' class="{text(css_class)}"' if css_class else ""
    source = data_uri(picture, lossless)
    return f'<img{attribute} src="{source}" width="{width}" height="{height}" alt="{text(alt)}" loading="lazy">'


def figure(content: str, title: str, caption: str = "", legend: str = "", css_class: str = "") -> str:
    """Content (HTML) with a title (plain text), a legend and a caption (HTML)."""
    below = f"<p>{caption}</p>" if caption else ""
    return (
        f'<figure class="{text(css_class)}"><figcaption><b>{text(title)}</b></figcaption>{content}{legend}'
        f"<figcaption>{below}</figcaption></figure>"
    )


def table(head: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int] = (), css_class: str = "") -> str:
    """A table of HTML cells in a box that scrolls sideways; `numeric` columns are set flush right."""
    side = ['class="n"' if k in numeric else "" for k in range(len(head))]
    top = "".join(f'<th scope="col" {side[k]}>{cell}</th>' for k, cell in enumerate(head))
    body = "".join(
        "<tr>" + "".join(f"<td {side[k]}>{cell}</td>" for k, cell in enumerate(row)) + "</tr>\n" for row in rows
    )
    return (
        f'<div class="scroll"><table class="{text(css_class)}"><thead><tr>{top}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def tiles(entries: Sequence[tuple[str, str]]) -> str:
    """Key figures: (value, what it is), both plain text."""
    cells = "".join(f"<div><b>{text(value)}</b><span>{text(name)}</span></div>" for value, name in entries)
    return f'<div class="tiles">{cells}</div>'


def swatches(entries: Sequence[tuple[str, str]]) -> str:
    """A legend: (CSS colour, plain text)."""
    cells = "".join(f'<li><i style="background:{text(colour)}"></i>{text(name)}</li>' for colour, name in entries)
    return f'<ul class="legend">{cells}</ul>'


def page(title: str, body: str) -> str:
    """A whole document; `title` is plain text, `body` HTML."""
    style = "".join(sheet.read_text(encoding="utf-8") for sheet in (COLOURS, STYLE, FIGURES))
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n<link rel="icon" href="data:,">\n'
        f"<title>{text(title)}</title>\n<style>\n{style}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def write_page(path: Path, title: str, body: str) -> None:
    """Writes the whole page or nothing, its folder first. Raises ItreeError when it cannot be written."""
    write_document(path, page(title, body))


def write_document(path: Path, content: str) -> None:
    """Writes a whole file or nothing, its folder first. Raises ItreeError when it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ItreeError(f"{path}: its folder cannot be made ({error.strerror})") from error
    write_whole(path, content)
