"""The check of the active variant, for every kind of function that has one."""

from __future__ import annotations

import mitsuba as mi
import pytest

from mi_enhance.system.variants import require_variant


@pytest.mark.parametrize(
    "variant, needs, lacks",
    [
        ("llvm_ad_rgb", {"rgb": True, "jit": True, "gradients": True}, None),
        ("scalar_rgb", {"rgb": True}, None),
        ("scalar_spectral", {}, None),
        ("scalar_rgb", {"rgb": True, "jit": True}, "an RGB variant that is not scalar"),
        ("scalar_rgb", {"gradients": True}, "a variant with gradients"),
        ("llvm_ad_spectral", {"rgb": True, "gradients": True}, "an RGB variant with gradients"),
    ],
)
def test_a_variant_has_what_is_asked_or_is_named(variant, needs, lacks):
    if variant not in mi.variants():
        pytest.skip(f"{variant} is not part of this Mitsuba")
    mi.set_variant(variant)
    try:
        if lacks is None:
            require_variant("fit()", **needs)
        else:
            with pytest.raises(RuntimeError, match=rf'fit\(\): needs {lacks}; "{variant}" is active\. Call mi\.set_'):
                require_variant("fit()", **needs)
    finally:
        mi.set_variant("llvm_ad_rgb")
