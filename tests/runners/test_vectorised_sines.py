"""The sines of compiled runs are those of numpy."""

import numpy as np

from sysid.runners.compiled import compiled, jax_module, vectorised


def test_sines_of_many_numbers_are_those_of_numpy() -> None:
    xp = vectorised(jax_module().numpy)
    x = np.random.default_rng(2).uniform(-1e5, 1e5, 4096)
    np.testing.assert_allclose(compiled(xp.sin)(x), np.sin(x), rtol=0.0, atol=1e-15)
    # x + π/2 rounds to the spacing of numbers at 1e5, 1.5e-11
    np.testing.assert_allclose(compiled(xp.cos)(x), np.cos(x), rtol=0.0, atol=2e-11)
    whole = np.pi * np.arange(-4.0, 5.0)
    np.testing.assert_allclose(compiled(xp.cos)(whole), np.cos(whole), rtol=0.0, atol=1e-15)
