"""Colours that stay apart for colour-blind readers (Okabe and Ito 2008). Colour is never the only sign: numbers, text
or the shape of a line say the same."""

Rgb = tuple[int, int, int]

ORANGE: Rgb = (230, 159, 0)
SKY: Rgb = (86, 180, 233)
GREEN: Rgb = (0, 158, 115)
YELLOW: Rgb = (240, 228, 66)
BLUE: Rgb = (0, 114, 178)
WINE: Rgb = (136, 34, 85)  # of Tol's muted set: an eighth colour that stays apart from the seven
VERMILLION: Rgb = (213, 94, 0)
PURPLE: Rgb = (204, 121, 167)
GREY: Rgb = (150, 150, 150)
WHITE: Rgb = (255, 255, 255)
BLACK: Rgb = (0, 0, 0)

CYCLE = (ORANGE, SKY, GREEN, YELLOW, VERMILLION, PURPLE, BLUE, WINE)

# These three differ in lightness too, so that a print in grey still tells them apart.
AGREE, CONTRADICT, HIDDEN = SKY, VERMILLION, YELLOW
TRUTH = WHITE


def cycle(k: int) -> Rgb:
    """Colour of the k-th thing; after eight they repeat."""
    return CYCLE[k % len(CYCLE)]


def css(colour: Rgb) -> str:
    """As CSS writes it, such as "#0072b2"."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def ink_on(colour: Rgb) -> Rgb:
    """Black or white, whichever can be read on the colour."""
    return BLACK if 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2] > 120 else WHITE
