"""Float64, switched on in one place and on purpose."""


def enable_float64() -> None:
    """Make JAX compute in double precision.

    Calibration differences are 1e-6 of the signal and less, so everything here is float64. JAX starts in float32:
    call this once, before any array is made. The command line does so itself; building a chain without it
    raises an error that says so.
    """
    import jax

    jax.config.update("jax_enable_x64", True)


def require_float64() -> None:
    """Refuse to compute in single precision.

    **Raises:** `RuntimeError` when float64 is off.
    """
    import jax

    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise RuntimeError("tumblecal computes in float64: call tumblecal.enable_float64() before building a chain")
