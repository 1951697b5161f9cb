"""The only module that imports and configures JAX: double precision, compilation cache."""

import os
from functools import cache
from math import factorial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

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


def vectorised(jnp: Any) -> Any:
    """``jax.numpy`` with sines that run on several numbers at once, and a plain ``where``.

    XLA calls the C library for each sine of a double, which costs as much as ten other steps of an
    effect. With n = round(x/π), sin x = (−1)ⁿ sin(x − nπ), where a polynomial serves. And each
    ``where`` of JAX is a compiled function of its own, which takes longer to trace and to lower.
    """
    lax = jax_module().lax

    def where(condition: Any, yes: Any, no: Any) -> Any:
        yes, no = jnp.asarray(yes), jnp.asarray(no)
        kind = jnp.promote_types(yes.dtype, no.dtype)
        shape = jnp.broadcast_shapes(condition.shape, yes.shape, no.shape)
        chosen = (jnp.broadcast_to(x.astype(kind), shape) for x in (yes, no))
        return lax.select(jnp.broadcast_to(condition, shape), *chosen)

    def sin(x: Any) -> Any:
        n = jnp.round(x / np.pi)
        y = (x - n * _PI[0]) - n * _PI[1]
        square = y * y
        result = jnp.zeros_like(y)
        for c in reversed(_SINE):
            result = result * square + c
        return result * y * (1.0 - 2.0 * jnp.abs(n - 2.0 * jnp.round(0.5 * n)))

    def cos(x: Any) -> Any:
        return sin(x + 0.5 * np.pi)

    return SimpleNamespace(**{**vars(jnp), "sin": sin, "cos": cos, "where": where})


_SINE = tuple((-1.0) ** k / factorial(2 * k + 1) for k in range(11))
"""Taylor's polynomial: its remainder within ±π/2 is below the last digit of a double."""

_PI = (3.141592651605606, 1.984187159361081e-09)
"""π in two parts, of which the first leaves n π exact for the n that occur."""


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
