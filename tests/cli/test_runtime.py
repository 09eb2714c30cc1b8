"""JAX as the command line wants it: no asynchronous dispatch, and compiled functions kept in the user's cache."""

import os
import subprocess
import sys

PROGRAM = """
import jax
from itree_jax.cli.runtime import start_jax, COMPILED_IN
start_jax()
print(jax.config.jax_compilation_cache_dir)
print(jax.config._read("jax_cpu_enable_async_dispatch"))
print(jax.config.jax_persistent_cache_min_compile_time_secs == COMPILED_IN)
"""


def lines(**environment):
    kept = {k: v for k, v in os.environ.items() if not k.startswith("JAX_") and k != "XDG_CACHE_HOME"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=60, check=True, env=kept | environment
    )
    return done.stdout.splitlines()


def test_compiled_functions_are_kept_in_the_users_cache(tmp_path):
    assert lines(XDG_CACHE_HOME=str(tmp_path)) == [str(tmp_path / "itree-jax" / "jax"), "False", "True"]
    assert (tmp_path / "itree-jax" / "jax").is_dir()
    home = str(tmp_path / "home")
    assert lines(HOME=home)[0] == f"{home}/.cache/itree-jax/jax"


def test_a_cache_that_the_user_chose_is_kept(tmp_path):
    mine = str(tmp_path / "mine")
    assert lines(JAX_COMPILATION_CACHE_DIR=mine) == [mine, "False", "True"]
    chosen = lines(JAX_COMPILATION_CACHE_DIR=mine, JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS="3.0")
    assert chosen == [mine, "False", "False"]


def test_a_home_that_cannot_be_written_to_is_no_error(tmp_path):
    (tmp_path / "file").write_text("")
    assert lines(XDG_CACHE_HOME=str(tmp_path / "file"))[0] == "None"
