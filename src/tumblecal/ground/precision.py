"""Arithmetic of the process: float64, enabled explicitly in one place, and the threads of the linear algebra."""

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


def enable_float64() -> None:
    """Make JAX compute in double precision.

    Calibration differences are 1e-6 of the signal and less, so all computations need float64. The default of JAX is float32:
    call this once, before any array is created. The command line calls it; a chain cannot be built without it.

    Examples:
        >>> import tumblecal
        >>> tumblecal.enable_float64()
        >>> import jax.numpy as jnp
        >>> jnp.zeros(3).dtype.name
        'float64'
    """
    import jax

    jax.config.update("jax_enable_x64", True)


def require_float64() -> None:
    """Reject computations in single precision.

    **Raises:** `RuntimeError` if float64 is not enabled.
    """
    import jax

    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise RuntimeError("tumblecal computes in float64: call tumblecal.enable_float64() before building a chain")


@cache
def _threads() -> ThreadpoolController:
    return ThreadpoolController()


def single_blas_thread() -> AbstractContextManager:
    """For matrices of a hundred rows: threads would only wait for each other."""
    return _threads().limit(limits=1, user_api="blas")
