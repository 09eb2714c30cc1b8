"""JAX as a short-lived program wants it. To be called before the first computation."""

import os
from pathlib import Path

KEPT_FROM = "jax_persistent_cache_min_compile_time_secs"
COMPILED_IN = 0.05  # [s]: a function that took longer to compile is kept for the next run


def start_jax() -> None:
    """Switches asynchronous dispatch off and keeps compiled functions on disk, so that the second run starts fast.

    With asynchronous dispatch on a CPU, a process that ends while a kernel is in flight hangs. A cache folder that the
    user has chosen (JAX_COMPILATION_CACHE_DIR) is left as it is, and so is what is kept in it
    (JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS).
    """
    import jax

    jax.config.update("jax_cpu_enable_async_dispatch", False)
    if KEPT_FROM.upper() not in os.environ:
        jax.config.update(KEPT_FROM, COMPILED_IN)
    if jax.config.values["jax_compilation_cache_dir"] is not None:
        return
    folder = cache_folder() / "jax"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # a home that cannot be written to only costs time
    jax.config.update("jax_compilation_cache_dir", str(folder))


def cache_folder() -> Path:
    """Where this program keeps what it can make again: $XDG_CACHE_HOME/itree-jax, or ~/.cache/itree-jax."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "itree-jax"
