"""The check of the active Mitsuba variant: what a function needs of it."""

from __future__ import annotations

import mitsuba as mi


def require_variant(where: str, *, rgb: bool = False, jit: bool = False, gradients: bool = False) -> None:
    """Raise unless a variant is active that has what is asked for.

    Parameters
    ----------
    where : str
        Function that asks: the error begins so.
    rgb : bool
        Colours are linear RGB, neither spectra nor grey.
    jit : bool
        Arrays are Dr.Jit's: no scalar variant.
    gradients : bool
        Values can be differentiated, which implies `jit`.

    Raises
    ------
    RuntimeError
        If no variant is active, or one without these.

    Examples
    --------
    >>> mi.set_variant("llvm_ad_rgb")
    >>> require_variant("fit()", rgb=True, gradients=True)
    """
    variant, advice = mi.variant(), 'Call mi.set_variant("llvm_ad_rgb") first.'
    if variant is None:
        raise RuntimeError(f"{where}: no Mitsuba variant is active. {advice}")
    lacks = (
        (rgb and not variant.endswith("_rgb"))
        or (jit and variant.startswith("scalar"))
        or (gradients and "_ad_" not in variant)
    )
    if lacks:
        kind = "an RGB variant" if rgb else "a variant"
        extra = " with gradients" if gradients else " that is not scalar" if jit else ""
        raise RuntimeError(f'{where}: needs {kind}{extra}; "{variant}" is active. {advice}')


def require_rgb(where: str) -> None:
    """Raise unless a variant is active in which RGB parameters can be optimized."""
    require_variant(where, rgb=True, gradients=True)
