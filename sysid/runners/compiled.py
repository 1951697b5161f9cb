"""The only module that imports and configures JAX: double precision, compilation cache."""

import os
from functools import cache
from pathlib import Path
from typing import Any

KEPT_FROM = 0.1
"""Compilations that took longer than this are kept on disk [s]."""


@cache
def jax_module() -> Any:
    """``jax``, computing in double precision and keeping its compilations between commands.

    They are kept in ``$SYSID_CACHE``, else in the user's cache folder; where neither can be
    written, nothing is kept and every command compiles anew.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    folder = cache_folder()
    if folder is not None:
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", KEPT_FROM)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return jax


def compiled(function: Any) -> Any:
    """``jax.jit`` of a function that is a long chain of elementwise steps on small arrays.

    XLA's newer fusion emitters repeat shared parts of such chains for every use: steps with
    friction ran three times slower and took twice as long to compile. With LLVM's first level the
    same numbers come a quarter sooner than with its third, and in one part the code compiles a
    quarter sooner. Versions of JAX without these switches compile as they like.
    """
    return jax_module().jit(function, compiler_options=_options())


@cache
def _options() -> dict[str, bool | int] | None:
    jax = jax_module()
    options = {
        "xla_cpu_use_fusion_emitters": False,
        "xla_backend_optimization_level": 1,
        "xla_cpu_parallel_codegen_split_count": 1,
    }
    try:
        jax.jit(lambda x: x + 1.0, compiler_options=options)(0.0)
    except Exception:  # whatever a version raises for a switch it does not know
        return None
    return options


def cache_folder() -> Path | None:
    """Where compilations are kept, made if need be; None where that is not possible."""
    named, base = os.environ.get("SYSID_CACHE"), os.environ.get("XDG_CACHE_HOME")
    try:
        root = Path(named) if named else Path(base or Path.home() / ".cache") / "sysid"
        folder = root / "compiled"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return None
    return folder if os.access(folder, os.W_OK) else None
