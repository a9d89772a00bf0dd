"""A material that varies over a surface: some of its parameters are maps, one multi-channel OpenEXR file holds them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

import mitsuba as mi
import numpy as np

from ..analytic import parameters
from ..neural import mlp
from ..system.exr_channels import read_channels
from ..system.files import digest, replacing, require_file
from .description import parse
from .material import Material

FORMAT = 1  # of the files; a reader refuses what is newer
_KIND = "mi_enhance maps"
_ATTRIBUTE = "mi_enhance"  # of the EXR header: a JSON text


@dataclasses.dataclass(frozen=True, eq=False)
class MaterialMaps:
    """A material some of whose parameters have a value of their own at every texel.

    Parameters
    ----------
    material : Material
        Networks, and the parameters that are the same everywhere.
    maps : dict of str to array (H, W, C)
        Parameters that vary, by name, as many channels as the parameter has numbers. Kept as float32. What is out of
        range counts as the bound, as in any texture of the plugin.

    Raises
    ------
    ValueError
        For no map at all, an unknown name, a wrong shape, NaN or infinity, a specialized material.

    Examples
    --------
    >>> halves = np.repeat([[[0.1], [0.4]]], 2, axis=0)
    >>> m = MaterialMaps(Material.analytic("ggx"), {"alpha_x": halves, "alpha_y": halves})
    >>> m.shape, m.at(0, 1).params["alpha_x"].round(3), m.at(0, 1).params["F0"]
    ((2, 2), array([0.4]), array([0.04]))
    """

    material: Material
    maps: Mapping[str, np.ndarray]

    def __post_init__(self):
        object.__setattr__(self, "maps", _checked(self.material, self.maps, "MaterialMaps"))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in texels."""
        return next(iter(self.maps.values())).shape[:2]

    def at(self, row: int, column: int) -> Material:
        """The material of one texel."""
        inside = {p.name: (p.low, p.high) for p in self.material.brdf.parameters}
        values = {name: np.clip(v[row, column], *inside[name]) for name, v in self.maps.items()}
        # not an edit, which holds what factors in RGB reflect
        return dataclasses.replace(self.material, params={**self.material.params, **values})

    def as_vectors(self) -> np.ndarray:
        """All parameters of every texel, (H, W, P), in the order of :meth:`Material.as_vector`."""
        columns = {name: np.broadcast_to(v, (*self.shape, len(v))) for name, v in self.material.params.items()}
        columns |= dict(self.maps)
        return np.concatenate([columns[p.name] for p in self.material.brdf.parameters], axis=2)

    # ------------------------------------------------------------------ in a scene

    def bsdf(self, filter_type: str = "bilinear") -> mi.BSDF:
        """The Mitsuba BSDF, straight from memory; see :meth:`to_dict`."""
        return mi.load_dict(self.to_dict(filter_type))

    def to_dict(self, filter_type: str = "bilinear") -> dict:
        """The dictionary that ``mi.load_dict`` takes, to be placed in a scene.

        Parameters
        ----------
        filter_type : {"bilinear", "nearest"}
            Between texels: parameters interpolated, or those of the nearest.
        """
        names, pixels = self._stacked()
        return {
            **self.material.to_dict(),
            "maps": mi.TensorXf(pixels),
            "channels": " ".join(names),
            "filter_type": filter_type,
        }

    @staticmethod
    def from_arrays(material: Material, channels: str, pixels: np.ndarray) -> MaterialMaps:
        """Rebuild what :meth:`to_dict` took apart."""
        where = 'bsdf "enhanced": maps'
        named = dict(zip(channels.split(), np.moveaxis(pixels, 2, 0), strict=True))
        return MaterialMaps(material, _joined(material, named, where))

    def _stacked(self) -> tuple[list[str], np.ndarray]:
        """Names of all channels, and one array (H, W, channels)."""
        names = [c for p in self.material.brdf.parameters if p.name in self.maps for c in parameters.components(p)]
        order = [p.name for p in self.material.brdf.parameters if p.name in self.maps]
        return names, np.concatenate([self.maps[name] for name in order], axis=2)

    # ------------------------------------------------------------------ files

    def save(self, path: str | Path) -> None:
        """Write one OpenEXR file, float32 channels ``rho_d.R``, ``alpha_x``, ``latent.00``, ...

        The networks and what does not vary stay in the material's own file: save ``maps.material`` beside it. The
        header holds a digest of the networks: maps mean nothing to others.

        Parameters
        ----------
        path : str or Path
            ``.exr``; replaced as a whole or not at all.
        """
        import OpenEXR

        if Path(path).suffix.lower() != ".exr":
            raise ValueError(f'MaterialMaps.save(): "{path}" must end in .exr: maps are an OpenEXR file.')
        names, pixels = self._stacked()
        header = {
            "compression": OpenEXR.ZIP_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            _ATTRIBUTE: json.dumps(self._description()),
        }
        channels = {name: np.ascontiguousarray(pixels[..., k]) for k, name in enumerate(names)}
        with replacing(path) as temporary, OpenEXR.File(header, channels) as file:
            file.write(str(temporary))

    @staticmethod
    def load(path: str | Path, material: Material) -> MaterialMaps:
        """Read maps for a material with the networks they were made with.

        Parameters
        ----------
        path : str or Path
        material : Material
            What does not vary is taken from it.

        Raises
        ------
        FileNotFoundError, ValueError
            If the file is missing, damaged, cropped, newer than this package, made for other networks, or if a channel
            is missing, unknown or holds NaN.
        """
        where = f'MaterialMaps.load("{path}")'
        channels, header = read_channels(require_file(path, where), where)
        if _ATTRIBUTE not in header:
            raise ValueError(
                f'{where}: an OpenEXR file, but not maps of mi_enhance: its header has no "{_ATTRIBUTE}". A single '
                "texture goes into the scene by the name of its parameter."
            )
        description = parse(header[_ATTRIBUTE], where, _KIND, FORMAT)
        ours = _digest(material)
        if description.get("digest") != ours:
            raise ValueError(
                f"{where}: these maps belong to {description.get('equation')} with weights "
                f"{description.get('digest')}; the material given is {material.brdf} with weights {ours}. Give the "
                "material that was saved with the maps, or one fitted with the same network."
            )
        maps = _joined(material, channels, where)
        report = description.get("report", {})
        material = dataclasses.replace(material, report=report if isinstance(report, dict) else {})
        return MaterialMaps(material, _checked(material, maps, where))

    def _description(self) -> dict:
        return {
            "kind": _KIND,
            "format": FORMAT,
            "equation": str(self.material.brdf),
            "digest": _digest(self.material),
            "versions": {name: metadata.version(name) for name in ("mi-enhance", "mitsuba", "drjit", "numpy")},
            "report": self.material.report,
        }


def _digest(material: Material) -> str:
    """Changes with the model, its parameters and the weights of its networks, not with parameter values."""
    brdf = material.brdf
    text = json.dumps(
        [brdf.model.name, brdf.model.text, str(brdf), brdf.inputs, [[p.name, p.size] for p in brdf.parameters]]
    )
    return digest(text.encode(), mlp.flatten(brdf.networks).tobytes())


def _checked(material: Material, maps: Mapping, where: str) -> dict[str, np.ndarray]:
    """The maps in the order of the parameters, or an error."""
    if material.brdf.distilled:
        raise ValueError(
            f"{where}: a specialized material holds for one set of parameters. Give material.unspecialized."
        )
    sizes = {p.name: p.size for p in material.brdf.parameters}
    unknown = sorted(set(maps) - set(sizes))
    if unknown:
        raise ValueError(f'{where}: unknown parameter "{unknown[0]}". Choose from: {", ".join(sizes)}.')
    if not maps:
        raise ValueError(
            f"{where}: no map at all. Give at least one parameter that varies, or use the material itself."
        )
    result = {name: np.asarray(maps[name], np.float32) for name in sizes if name in maps}
    first = next(iter(result))
    for name, v in result.items():
        wanted = (*result[first].shape[:2], sizes[name])
        if v.shape != wanted or 0 in v.shape:
            raise ValueError(f"{where}: {name} has shape {v.shape}; {wanted} is needed (height, width, numbers).")
        if not np.isfinite(v).all():
            y, x, k = np.argwhere(~np.isfinite(v))[0]
            raise ValueError(f"{where}: {name} is {v[y, x, k]} at row {y}, column {x}; all values must be finite.")
    return result


def _joined(material: Material, channels: Mapping[str, np.ndarray], where: str) -> dict[str, np.ndarray]:
    """Channels joined to parameters: all of a parameter must be there, and nothing else."""
    known = {p.name: parameters.components(p) for p in material.brdf.parameters}
    unknown = sorted(set(channels) - {c for names in known.values() for c in names})
    if unknown:
        raise ValueError(
            f'{where}: unknown channel "{unknown[0]}". Known: {", ".join(n[0] for n in known.values())}, ...'
        )
    maps = {}
    for name, wanted in known.items():
        missing = [c for c in wanted if c not in channels]
        if missing and len(missing) < len(wanted):
            raise ValueError(
                f'{where}: channel "{missing[0]}" is missing; {name} has {len(wanted)}. Save the maps again.'
            )
        if not missing:
            maps[name] = np.stack([channels[c] for c in wanted], axis=2)
    return maps
