"""What an installed package must do from any folder; run by `make dist-check`, alone, with the Python it is in.

Asserts and exits: no test runner and nothing of the checkout is needed.
"""

from __future__ import annotations

import importlib.metadata
import sys
import tempfile
from pathlib import Path

import mi_enhance as me

import mitsuba as mi  # isort: skip


def main() -> None:
    package = Path(me.__file__).parent
    assert Path(sys.prefix) in package.parents, f"{package} is not what was installed into {sys.prefix}"
    assert importlib.metadata.version("mi-enhance") == me.__version__
    assert (package / "py.typed").exists()
    mi.set_variant("llvm_ad_rgb")
    from mi_enhance.system import bundled_files

    samples = me.data.load(bundled_files.demo_data("satin_rosaline_rgb.bsdf"), n_samples=500)
    assert samples.f.max() > 0
    material = me.Material.pretrained("ggx2").edit(rho_d=0.5)
    with tempfile.TemporaryDirectory() as folder:
        material.save(Path(folder) / "m.bsdf")
        loaded = me.load_material(Path(folder) / "m.bsdf")
    scene = mi.load_file(
        str(bundled_files.scene_file("sphere_envmap.xml")),
        **{"material": str(bundled_files.network_file("ggx")), "resolution": "16"},
    )
    image = mi.render(scene, spp=1)
    assert image.shape[:2] == (16, 16) and float(mi.Float(image.array)[0]) >= 0
    assert "rho_d" in loaded.show()
    print(f"mi-enhance {me.__version__} works from {package}")


if __name__ == "__main__":
    main()
