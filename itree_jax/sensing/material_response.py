"""The response of a material: what photometric stereo sees -> the normal, as a smooth map of low order.

Ikeuchi's own systems looked normals up in a table of brightness triples, measured on a sphere of the material. Here the
table is a cubic: b = albedo * normal, as Lambert's law reads it from the intensities, goes in (for three lights that is
the brightness triple in other coordinates), the normal comes out. One map for each set of lights that reach a pixel. A
second, smooth function of the normal tells how long b should be, so that what the material would not show (a shadow, a
neighbour's reflection) is not believed.

It is fitted wherever normals are known: a sphere of the material, a depth map, recognised parts. It is kept only where
it predicts normals that it was not fitted on better than Lambert's law does, and where that law errs by more than noise
(a map of one material knows its albedo too and always filters some noise). A material is Lambertian or it is not: what
is gained only on pixels that few lights reach, beside shadows, is their interreflection and no response.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from itree_jax.sensing.albedo import INTERREFLECTION, dominant_albedo
from itree_jax.sensing.needle import NeedleMap

DEGREE = 3  # squares and cubes of b carry a broad lobe; higher orders only follow the errors of the reference
LENGTH_DEGREE = 4  # of the length of b over the normal's x and y: a lobe is a bump
LEAST_PIXELS = 500  # 20 coefficients each from 25 pixels
MOST_PIXELS = 4000  # of a set, 200 for each coefficient: more only take time, since neighbours share their errors
LEAST_GAIN = 0.1  # the error on pixels left out must fall by so much: less is what the fit's own scatter may do
LAW_OFF = 1.5  # times what sensor noise makes of the error, or more: less is not the law's fault
MEDIAN_OF_RMS = np.sqrt(np.log(2.0))  # of a Gaussian deviation in two directions
BLOCK = 16  # [px]: neighbours share their errors, so whole blocks are left out
ITERATIONS = 12  # of reweighting; the weights settle in six to ten
SAME_MATERIAL = 2.5  # times the dominant albedo or less: a lobe doubles what is seen, a bin is several times darker
TUKEY = 4.685  # scales beyond which a residual has no weight: 95 % efficient if errors were Gaussian
WIDE = np.radians(20.0)  # the first scale: Lambert's law is off by 5 to 20 degrees on metal
RIDGE = 1e-4  # of the mean squared feature: keeps coefficients finite where normals cover little of the sphere
AT_ONCE = 8192  # pixels that the map is applied to together: their terms stay in the cache


@dataclass(frozen=True)
class SetResponse:
    """The response under one set of lights."""

    normal: Float[np.ndarray, "terms 3"]  # coefficients of the monomials of b / unit
    length: Float[np.ndarray, "terms2"]  # coefficients of |b| / unit over the normal's x and y
    length_std: float  # relative scatter of |b| about it
    residual: float  # [rad] rms of the robust core, on pixels left out
    lambertian: float  # [rad] the same without the response


@dataclass(frozen=True)
class MaterialResponse:
    """Responses by set of lights (bit i: light i reaches); sets that it would not improve are missing."""

    unit: float  # of b: the dominant albedo
    sets: dict[int, SetResponse]
    lights: int

    @property
    def is_lambertian(self) -> bool:
        """Nothing was kept."""
        return not self.sets


def fit_response(
    needle: NeedleMap, normals: Float[np.ndarray, "height width 3"], known: Bool[np.ndarray, "height width"]
) -> MaterialResponse:
    """The response from normals [camera frame] that are known at some pixels. Runs on the host.

    A set of lights gets a map if it reaches enough of these pixels, and if the map fitted on one half of the image's
    blocks is nearer to the known normals in the other half, both ways round. None does unless the set that reaches
    most of them does.
    """
    unit = float(dominant_albedo(needle)) or 1.0
    code, b = light_sets(needle), _b(needle).reshape(-1, 3) / unit
    use = known & np.asarray(needle.interpretable)
    use &= np.abs(np.log(np.maximum(np.asarray(needle.albedo), 1e-6) / unit)) < np.log(SAME_MATERIAL)
    v, u = np.indices(use.shape)
    half = ((v // BLOCK + u // BLOCK) % 2).astype(bool)
    noise = MEDIAN_OF_RMS * np.asarray(needle.normal_std, np.float64)
    sets: dict[int, SetResponse] = {}
    codes, counts = np.unique(code[use], return_counts=True)
    for k in np.argsort(-counts, kind="stable"):
        if counts[k] < LEAST_PIXELS:
            break
        some = np.flatnonzero(use & (code == codes[k]))[:: -(-int(counts[k]) // MOST_PIXELS)]
        known_normals = normals.reshape(-1, 3)[some].astype(np.float64)
        kept = _fit_set(b[some], known_normals, half.ravel()[some], float(np.median(noise.ravel()[some])))
        if kept is not None:
            sets[int(codes[k])] = kept
        elif not sets:
            break
    return MaterialResponse(unit, sets, np.asarray(needle.shadowed).shape[0])


def apply_response(needle: NeedleMap, response: MaterialResponse) -> NeedleMap:
    """The needle map as the material's response reads it; pixels of sets without a map stay as they are.

    `confidence` is then how near the length of b is to what the material shows at that normal, `normal_bias` the error
    of the map. NumPy arrays.
    """
    normals, confidence = np.array(needle.normals, np.float32), np.array(needle.confidence, np.float32)
    bias, interpretable = np.array(needle.normal_bias, np.float32), np.array(needle.interpretable)
    code, b = light_sets(needle), _b(needle) / response.unit
    for one, fitted in response.sets.items():
        here = np.flatnonzero(interpretable & (code == one))
        for block in np.array_split(here, -(-len(here) // AT_ONCE)) if len(here) else ():
            v, u = np.divmod(block, code.shape[1])
            normals[v, u] = _map(fitted.normal, b[v, u])
            expected = np.maximum(length_terms(normals[v, u]) @ fitted.length, 0.05)
            deviation = (np.linalg.norm(b[v, u], axis=-1) / expected - 1.0) / fitted.length_std
            confidence[v, u] = np.exp(-0.5 * deviation**2)
            bias[v, u] = fitted.residual
    interpretable &= normals[..., 2] < 0.0
    return needle._replace(
        normals=normals, confidence=np.where(interpretable, confidence, 0.0), normal_bias=bias,
        interpretable=interpretable,
    )


def light_sets(needle: NeedleMap) -> Int[np.ndarray, "height width"]:
    """Which lights made the normal of each pixel, bit i for light i."""
    reaching = np.asarray(needle.reaching)
    return (reaching.astype(np.int64) << np.arange(len(reaching))[:, None, None]).sum(axis=0)


def normal_terms(b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n terms"]:
    """Monomials of b up to DEGREE."""
    x, y, z = (_powers(v, DEGREE) for v in b.T)
    degrees = [(i, j, k) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i) for k in range(DEGREE + 1 - i - j)]
    return np.stack([x[i] * y[j] * z[k] for i, j, k in degrees], axis=-1)


def length_terms(normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n terms"]:
    """Monomials of the normal's x and y up to LENGTH_DEGREE."""
    x, y = (_powers(v, LENGTH_DEGREE) for v in normals.T[:2])
    degrees = [(i, j) for i in range(LENGTH_DEGREE + 1) for j in range(LENGTH_DEGREE + 1 - i)]
    return np.stack([x[i] * y[j] for i, j in degrees], axis=-1)


def _powers(x: Float[np.ndarray, "n"], most: int) -> list[Float[np.ndarray, "n"]]:
    """x to the 0th .. `most`, by multiplication, which is faster than NumPy's power."""
    powers = [np.ones_like(x)]
    for _ in range(most):
        powers.append(powers[-1] * x)
    return powers


def _b(needle: NeedleMap) -> Float[np.ndarray, "height width 3"]:
    return np.asarray(needle.normals, np.float64) * np.asarray(needle.albedo, np.float64)[..., None]


def _map(coefficients: Float[np.ndarray, "terms 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return _unit(normal_terms(b) @ coefficients)


def _unit(n: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return n / np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-9)


def _fit_set(
    b: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], half: Bool[np.ndarray, "n"], noise: float
) -> SetResponse | None:
    """The map of all pixels, if Lambert's law errs by more than `noise` [rad], the median error that the sensor's noise
    makes, and maps of either half are better on the other one.
    """
    lambert = b / np.maximum(np.linalg.norm(b, axis=-1, keepdims=True), 1e-9)
    before, after = [], []
    for fitted_on, left_out in ((half, ~half), (~half, half)):
        if fitted_on.sum() < LEAST_PIXELS // 4 or left_out.sum() < LEAST_PIXELS // 4:
            return None
        predicted = _map(_fit_normals(b[fitted_on], normals[fitted_on]), b[left_out])
        before.append(np.median(_angles(lambert[left_out], normals[left_out])))
        after.append(np.median(_angles(predicted, normals[left_out])))
    if not all(a < (1.0 - LEAST_GAIN) * c and c > LAW_OFF * noise for a, c in zip(after, before, strict=True)):
        return None
    coefficients = _fit_normals(b, normals)
    length, scatter = _fit_length(np.linalg.norm(b, axis=-1), _map(coefficients, b))
    return SetResponse(coefficients, length, scatter, float(np.mean(after)), float(np.mean(before)))


def _fit_normals(b: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "terms 3"]:
    """Robust least squares, the scale falling from `WIDE` to that of the residuals."""
    terms = normal_terms(b)
    weight = np.ones(len(b))
    coefficients = np.zeros((terms.shape[1], 3))
    for k in range(ITERATIONS):
        coefficients = _ridge(terms, normals, weight)
        angle = _angles(_unit(terms @ coefficients), normals)
        scale = max(np.median(angle) / 0.6745, WIDE * 0.5**k, 1e-4)
        weight = np.clip(1.0 - (angle / (TUKEY * scale)) ** 2, 0.0, 1.0) ** 2
    return coefficients


def _fit_length(
    length: Float[np.ndarray, "n"], normals: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "terms"], float]:
    terms = length_terms(normals)
    weight, scale = np.ones(len(length)), 0.0
    coefficients = np.zeros(terms.shape[1])
    for _ in range(ITERATIONS):
        coefficients = _ridge(terms, length[:, None], weight)[:, 0]
        off = length / np.maximum(terms @ coefficients, 0.05) - 1.0
        scale = max(float(np.median(np.abs(off))) / 0.6745, 1e-3)
        weight = np.clip(1.0 - (off / (TUKEY * scale)) ** 2, 0.0, 1.0) ** 2
    return coefficients, max(scale, INTERREFLECTION)


def _ridge(
    terms: Float[np.ndarray, "n terms"], target: Float[np.ndarray, "n k"], weight: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "terms k"]:
    weighted = terms * weight[:, None]
    A = weighted.T @ terms
    A += RIDGE * np.trace(A) / len(A) * np.eye(len(A)) / max(len(terms), 1) ** 0.5
    return np.linalg.solve(A, weighted.T @ target)


def _angles(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Between unit vectors [rad]; by the chord, which keeps its digits at small angles."""
    return 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(a - b, axis=-1), 0.0, 1.0))
