"""Small files of other formats, written to their public descriptions; all hold the same smooth reflectance."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mi_enhance.data.directions import direction
from mi_enhance.system import tensor_file

SHAPE_MIT = (10, 10, 24, 12)


def smooth(wi, wo):
    """Not reciprocal, isotropic, slow in every angle; no channel is another."""
    wi, wo = (np.asarray(w, np.float64) for w in (wi, wo))
    along = np.sum(wi * wo, -1)
    f = 0.2 + 0.1 * wo[..., 2] + 0.03 * along
    return np.stack((f, f, f), -1)


def write_utia(path: Path, offset: float = 0.0) -> None:
    theta, phi = np.meshgrid(np.deg2rad(15.0 * np.arange(6)), np.deg2rad(7.5 * np.arange(48)), indexing="ij")
    w = direction(theta.ravel(), phi.ravel())  # theta the slower index
    f = smooth(w[None, :], w[:, None]) + offset  # rows: light, columns: viewer
    if path.suffix == ".bin":
        np.moveaxis(f, -1, 0).astype("<f8").tofile(path)
        return
    import OpenEXR

    channels = {c: np.ascontiguousarray(f[..., k].astype(np.float32)) for k, c in enumerate("RGB")}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(path))


def write_mit(path: Path, half: bool = False, hole: bool = False) -> None:
    shape = (*SHAPE_MIT[:2], SHAPE_MIT[2] // 2 if half else SHAPE_MIT[2], SHAPE_MIT[3])
    header = np.zeros(16, "<i4")
    header[:4], header[6], header[9], header[10] = shape, 1, half, 3
    ends = (np.pi / 2, np.pi / 2, np.pi if half else 2 * np.pi, 2 * np.pi)
    middles = [(np.arange(n) + 0.5) / n * end for n, end in zip(shape, ends, strict=True)]
    theta_in, theta_out, difference, phi_in = np.meshgrid(*middles, indexing="ij")
    f = smooth(direction(theta_out, phi_in + difference), direction(theta_in, phi_in))
    if hole:
        f[5:7] = -1  # 45 to 63 degrees of the light
    path.write_bytes(header.tobytes() + np.moveaxis(f, -1, 0).astype("<f4").tobytes())


def write_zemax(path: Path) -> None:
    from mi_enhance.data.zemax import directions

    incidences, azimuths, radials = [0, 30, 60], [0, 45, 90, 135, 180], [0, 5, 20, 40, 60, 80]
    lines = ["# by a test", "Source  Measured", "Symmetry  PlaneSymmetrical", "SpectralContent  Monochrome"]
    lines += ["ScatterType  BRDF", "SampleRotation  1", "0"]
    for name, values in (("AngleOfIncidence", incidences), ("ScatterAzimuth", azimuths), ("ScatterRadial", radials)):
        lines += [f"{name}  {len(values)}", "\t".join(map(str, values))]
    lines += ["", "Monochrome", "DataBegin"]
    for incidence in incidences:
        lines.append("TIS 0.5")
        for azimuth in azimuths:
            angles = np.deg2rad([[0.0] * len(radials), [incidence] * len(radials), [azimuth] * len(radials), radials])
            lines.append("  ".join(f"{v:.6e}" for v in smooth(*directions(*angles))[:, 0]))
    path.write_text("\n".join([*lines, "DataEnd", ""]))


def write_lighttools(path: Path) -> None:
    azimuths, radials = [0, 60, 120, 180, 240, 300], [0, 20, 40, 60, 80]
    lines = ["# by a test", "Symmetry Asymmetric", "SpectralContent Monochrome"]
    for name, values in (("ScatterAzimuth", azimuths), ("ScatterRadial", radials)):
        lines += [f"{name} {len(values)}", " ".join(map(str, values))]
    lines.append("DataBegin")
    for side in ("Front", "Back"):
        for aoi in (0, 30, 60):
            lines += [f"AOI {aoi}", "POI 0", f"Side {side}", "Wavelength 555", "ScatterType BRDF", "TIS 0.5"]
            phi, theta = np.deg2rad(np.stack(np.meshgrid(azimuths, radials, indexing="ij")).reshape(2, -1))
            light = direction(np.full(len(phi), np.deg2rad(aoi)), np.pi / 2)
            f = smooth(direction(theta, phi), light)[:, 0] * (1 if side == "Front" else 100)
            lines += [" ".join(f"{v:.6g}" for v in row) for row in f.reshape(len(azimuths), -1)]
    path.write_text("\n".join([*lines, "DataEnd", ""]))


def write_astm(path: Path, channels=("R", "G", "B"), degrees: bool = False) -> None:
    lines = ["DESC painted, by a test", "NUM_POINTS 45", f"VARS=theta_i,phi_i,theta_s,phi_s,{','.join(channels)}"]
    for theta_i in (0.0, 0.4, 0.8):
        for theta_s in (0.1, 0.5, 1.2):
            for phi_s in (-3.0, -1.0, 0.0, 1.0, 3.0):
                f = smooth(direction(theta_s, phi_s)[None], direction(theta_i, 0.0)[None])[0, 0]
                angles = np.array((theta_i, 0.0, theta_s, phi_s)) * (180 / np.pi if degrees else 1)
                lines.append(",".join(f"{v:.9g}" for v in (*angles, *[f] * len(channels))))
    path.write_text("\r\n".join([*lines, ""]))


def write_alta(path: Path, out: str | None = "INV_STERADIAN_COSINE_FACTOR") -> None:
    lines = ['#SAMPLE "a tape, by a test"', "#DIM 3 1", "#VS 0", "#PARAM_IN ISOTROPIC_TL_TV_PROJ_DPHI"]
    lines += [f"#PARAM_OUT {out}"] if out else []
    for theta_l in (0.25, 0.5, 1.0):
        for x, y in [(a, b) for a in np.linspace(-1.4, 1.4, 15) for b in np.linspace(-0.5, 0.5, 5)]:
            wi, wo = direction(np.hypot(x, y), np.arctan2(y, x)), direction(theta_l, 0.0)
            f = smooth(wi[None], wo[None])[0, 0] * (1 if out == "INV_STERADIAN" else wi[2])
            lines.append(f"{theta_l:.9f} {x:.9f}  {y:.9f}  {f:.9g}")
    path.write_text("\n".join([*lines, ""]))


def write_rgl(path: Path, *, spectral: bool = False, phi=None, rgb=None):
    """A file of RGL with flat distributions of normals, so that f is the table times a constant."""
    phi = np.zeros(1) if phi is None else np.asarray(phi)
    theta, n = np.linspace(0, 1.55, 5), 4
    rng = np.random.default_rng(6)
    nm = np.linspace(380, 780, 9)
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    azimuth = (1 + 0.5 * np.cos(phi))[:, None, None, None, None]
    table = 0.2 * azimuth * (1 + theta[None, :, None, None, None]) * (1 + u * v) + 0 * nm[None, None, :, None, None]
    table = table * (0.5 + rng.random(len(nm)))[None, None, :, None, None]
    fields = {
        "description": "a test",
        "jacobian": np.zeros(1, np.uint8),
        "phi_i": phi,
        "theta_i": theta,
        "ndf": np.ones((n, n)),
        "sigma": np.ones((n, n)),
        "vndf": np.ones((len(phi), len(theta), n, n)),
        "luminance": np.ones((len(phi), len(theta), n, n)),
    }
    if spectral:
        fields |= {"spectra": table, "wavelengths": nm}
    else:
        fields["rgb"] = table[:, :, [7, 4, 1]] if rgb is None else rgb
    tensor_file.write(
        path,
        {
            k: v if isinstance(v, str) or v.dtype == np.uint8 else np.ascontiguousarray(v, np.float32)
            for k, v in fields.items()
        },
    )
    return table, nm


FILES = {
    "utia": ("m001_cloth.bin", write_utia),
    "utia exr": ("m002_cloth.exr", write_utia),
    "mit": ("satin.dat", write_mit),
    "zemax": ("vinyl.bsdf", write_zemax),
    "lighttools": ("paint.bsdf", write_lighttools),
    "astm": ("garnet.astm", write_astm),
    "alta": ("tape.dat", write_alta),
    "rgl_spectral": ("paper_spec.bsdf", lambda path: write_rgl(path, spectral=True)),
    "rgl_anisotropic": ("brushed.bsdf", lambda path: write_rgl(path, phi=np.linspace(0, 2 * np.pi, 9))),
}
