"""Compiled functions whose traced program is kept on disk: a fresh process need not trace them again.

JAX's compilation cache keeps what XLA made of a program, but to find it there JAX traces the function and lowers it
first, which for the larger ones takes longer than to run them. `kept` keeps the program too (StableHLO, as `jax.export`
writes it), beside that cache and only where there is one. A program is found by the sources of this package, the
versions of JAX, and the shapes and types of the arguments.
"""

import hashlib
import inspect
from collections.abc import Callable, Iterator
from functools import cache, update_wrapper
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any, Generic, TypeVar, cast, get_args, get_type_hints

import itree_cad
import itree_kernels
import jax
import numpy as np
from itree_kernels.errors import ItreeError
from itree_kernels.whole_files import write_whole
from jax.core import Tracer
from jax.export import Exported, deserialize, register_namedtuple_serialization
from jax.export import export as exported

R = TypeVar("R")

FOLDER = "itree-programs"  # in the folder of JAX's compilation cache
SUFFIX = ".stablehlo"
DIGEST = hashlib.sha256().digest_size  # [bytes] of the checksum before the program
SETTINGS = ("jax_enable_x64", "jax_default_matmul_precision", "jax_numpy_dtype_promotion")  # change what is traced


def kept(*static: str) -> "Callable[[Callable[..., R]], KeptFunction[R]]":
    """`jax.jit` for functions of arrays, with its programs kept on disk; `static` names the static arguments.

    Static arguments must tell all about themselves by their `repr`. The function returns arrays, or NamedTuples and
    tuples of them as its annotation says. Inside another traced function, and for arrays that are spread over devices,
    it is the plain jitted function.
    """
    return lambda function: KeptFunction(function, static)


class KeptFunction(Generic[R]):
    """A jitted function that looks for its traced program on disk before it traces."""

    def __init__(self, function: Callable[..., R], static: tuple[str, ...]) -> None:
        update_wrapper(self, function)
        self._function, self._static = function, frozenset(static)
        self._name = getattr(function, "__name__", type(function).__name__)
        self._signature = inspect.signature(function)
        self._jitted = jax.jit(function, static_argnames=static)
        self._programs: dict[str, Callable[..., Any]] = {}
        self._making = Lock()  # threads that ask for the same at once wait for the first to trace and compile it

    def __call__(self, *args: Any, **kwargs: Any) -> R:
        folder = programs_folder()
        if folder is None:
            return self._jitted(*args, **kwargs)
        given = self._signature.bind(*args, **kwargs).arguments
        fixed = {name: value for name, value in given.items() if name in self._static}
        leaves, structure = jax.tree.flatten({name: value for name, value in given.items() if name not in fixed})
        if not all(map(_is_plain, leaves)):
            return self._jitted(*args, **kwargs)
        asked = f"{self.__module__}.{self._name} {fixed!r} {structure} {[_kind(leaf) for leaf in leaves]}"
        if asked in self._programs:
            return self._programs[asked](*leaves)

        def of_leaves(*flat: Any) -> Any:
            named: Any = structure.unflatten(flat) | fixed
            return self._function(**named)

        with self._making:
            if asked in self._programs:
                return self._programs[asked](*leaves)
            program = self._program(folder / f"{self._name}-{_key(asked)}{SUFFIX}", of_leaves, leaves)
            found = program(*leaves)  # compiles it
            self._programs[asked] = program
        return found

    def _program(self, path: Path, of_leaves: Callable[..., Any], leaves: list[Any]) -> Callable[..., Any]:
        """The program in a file, or the one traced now and put there."""
        _register_tuples(self._function)
        found = _read(path)
        if found is None:
            of_leaves.__name__ = self._name
            found = exported(jax.jit(of_leaves))(*map(_argument, leaves))
            _write(path, bytes(found.serialize()))
        return jax.jit(found.call)


def on_device(values: Any, dtype: Any = None) -> jax.Array:
    """A host array on the default device. `jnp.asarray` compiles a program for every shape that it is given."""
    return jax.device_put(np.asarray(values, dtype))


def programs_folder() -> Path | None:
    """Where programs are kept; None where JAX keeps no compiled functions on disk either."""
    folder = jax.config.values["jax_compilation_cache_dir"]
    if not folder or "://" in folder or not jax.config.values["jax_enable_compilation_cache"]:
        return None
    return Path(folder) / FOLDER


def _read(path: Path) -> Exported | None:
    """None where there is no program, or one that is not whole."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, program = content[:DIGEST], content[DIGEST:]
    return deserialize(bytearray(program)) if hashlib.sha256(program).digest() == digest else None


def _write(path: Path, program: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, hashlib.sha256(program).digest() + program)
    except (OSError, ItreeError):
        return  # a folder that cannot be written to only costs time


def _is_plain(leaf: Any) -> bool:
    """A number, a host array, or an array on the default device."""
    if isinstance(leaf, Tracer):
        return False
    return not isinstance(leaf, jax.Array) or leaf.devices() == {jax.local_devices()[0]}


def _kind(leaf: Any) -> tuple[Any, ...]:
    """What a traced program depends on."""
    if isinstance(leaf, np.ndarray | np.generic | jax.Array):
        return (leaf.shape, leaf.dtype.str if leaf.dtype.kind != "V" else leaf.dtype.name, _is_weak(leaf))
    return (type(leaf).__name__,)


def _is_weak(leaf: Any) -> bool:
    return bool(getattr(leaf, "weak_type", False))


def _argument(leaf: Any) -> jax.ShapeDtypeStruct:
    if isinstance(leaf, np.ndarray | np.generic | jax.Array):
        dtype = jax.dtypes.canonicalize_dtype(leaf.dtype)
        return jax.ShapeDtypeStruct(leaf.shape, dtype, weak_type=_is_weak(leaf))
    return jax.ShapeDtypeStruct((), jax.dtypes.canonicalize_dtype(np.result_type(leaf)), weak_type=True)


def _key(asked: str) -> str:
    settings = [jax.config.values[name] for name in SETTINGS]
    context = [_digest_of_sources(), jax.__version__, version("jaxlib"), jax.default_backend(), settings]
    return hashlib.sha256(f"{context} {asked}".encode()).hexdigest()[:32]


@cache
def _digest_of_sources() -> str:
    """Of all that a function may call: a program traced from other sources is another one."""
    digest = hashlib.sha256()
    packages = (Path(__file__).parent, *(Path(next(iter(p.__path__))) for p in (itree_cad, itree_kernels)))
    for path in sorted(path for package in packages for path in package.rglob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def _register_tuples(function: Callable[..., Any]) -> None:
    for kind in set(_tuples_in(get_type_hints(function)["return"])):
        _register(kind)


def _tuples_in(annotation: Any) -> Iterator[type]:
    """The NamedTuples that an annotation names, and those of their fields."""
    if isinstance(annotation, type) and hasattr(annotation, "_fields"):
        yield annotation
        for field in get_type_hints(annotation).values():
            yield from _tuples_in(field)
    for argument in get_args(annotation):
        yield from _tuples_in(argument)


@cache
def _register(kind: type) -> None:
    register_namedtuple_serialization(cast(Any, kind), serialized_name=f"{kind.__module__}.{kind.__qualname__}")
