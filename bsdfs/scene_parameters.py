"""The parameters of the plugin: values and textures that a scene gives, else those of the material, held in range."""

# Where types are ignored, the name is missing in Mitsuba's stubs, or of another type there.

from __future__ import annotations

import dataclasses
import weakref
from collections.abc import Collection, Iterator, Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from mi_enhance.bsdfs.map_textures import textures_of

from mi_enhance.analytic import parameters
from mi_enhance.analytic.parameters import Parameter
from mi_enhance.material.material import Material

# Wavelengths (nm) at which a textured spectrum is read as RGB for the networks: near the peaks of the sRGB primaries.
_RGB_WAVELENGTHS = (611.0, 549.0, 465.0)
# Materials whose read-outs are constants of a function of their own, which takes up to a second to compile; the rest of
# the living share one.
_MOST_LITERAL = 8
_literal: weakref.WeakSet[SceneParameters] = weakref.WeakSet()


def held(p: Parameter, value):
    """Return a value, or a list of them, held in the range of its parameter.

    The gradient passes as if nothing had been held: a clip would have none outside of the range, and an optimizer that
    has stepped out could not come back.
    """
    if isinstance(value, list):
        return [held(p, v) for v in value]
    inside = dr.clip(value, p.low, p.high)
    return dr.replace_grad(inside, value) if dr.grad_enabled(value) else inside


@dataclasses.dataclass(eq=False, init=False)  # a dataclass: `dr.freeze` finds the arrays of its fields
class SceneParameters:
    """Values and textures of the parameters of one BSDF.

    Parameters
    ----------
    props : mi.Properties
    material : Material
        Has what the scene does not give.
    where : str
        For error messages.
    """

    values: dict[str, Any]  # as they were put in
    textures: dict[str, Any]
    inside: dict[str, Any]  # the values held in range, of the last update
    literal: dict[str, Any]  # numbers of those that are constants of the compiled function, of the last update
    spectra: dict[str, tuple[mi.Texture, float]]  # the colours among the values, in spectral variants

    def __init__(self, props: Any, material: Material, where: str):
        brdf = material.brdf
        # a specialized material has them in the weights of its own network
        self._hidden = {p.name for p in brdf.parameters if p.kind == "latent" or p.name.startswith("norm_")}
        self._hidden = self._hidden if brdf.distilled else set()
        unread = set() if brdf.evaluated else self._hidden
        read = [p for p in brdf.parameters if p.name not in unread]
        self._parameters = {p.name: p for p in read}
        self._colours = [p.name for p in read if p.is_colour]
        self.values, self.textures, self.inside, self.spectra = {}, textures_of(props, material), {}, {}
        self.literal, self._trunk = {}, brdf.trunk
        for p in read:
            self._read(props, p, material.params[p.name], where)

    def _read(self, props: Any, p: Parameter, value: np.ndarray, where: str) -> None:
        """Take a parameter from the scene, else from the maps, else `value`, the material's."""
        if p.name in props and p.kind != "latent":
            self.textures.pop(p.name, None)
            given = props[p.name]
            spectrum = mi.Properties.Type.Spectrum  # type: ignore[attr-defined]
            is_spectrum = p.name in self._colours and props.type(p.name) == spectrum
            if is_spectrum or isinstance(given, mi.Texture):
                self.textures[p.name] = props.get_unbounded_texture(p.name)
                return
            try:
                numbers = np.atleast_1d(np.asarray(given, np.float64)).ravel()
            except (TypeError, ValueError):
                what = "a colour, spectrum" if p.name in self._colours else "a number"
                raise TypeError(f"{where}: {p.name} must be {what} or texture; got {given!r}.") from None
            value = parameters.check([p], {p.name: numbers}, where)[p.name]
        elif p.name in self.textures:
            return
        # Lists are copied: in memory of NumPy's own, aligned by chance, values would have kernels of their own.
        self.values[p.name] = mi.Color3f(value.tolist()) if p.is_colour else mi.Float(value.tolist())

    def check_uniform(self, where: str) -> None:
        """Raise where the table of one material would have to bound the energy of all that a texture makes of it."""
        wrong = sorted(name for name, texture in self.textures.items() if texture.is_spatially_varying())
        if wrong:
            raise ValueError(
                f"{where}: energy is bounded for one material at a time; {', '.join(wrong)} must not be textured here. "
                "Give a value, or set energy to false."
            )

    def traverse(self, cb) -> None:
        """Hand out values and textures, as ``mi.Object.traverse``."""
        for name, value in self.values.items():
            if name not in self._hidden:
                # Upsampling to spectra is not differentiable.
                flag = mi.ParamFlags.NonDifferentiable if name in self.spectra else mi.ParamFlags.Differentiable
                cb.put(name, value, flag)
        for name, texture in self.textures.items():
            cb.put(name, texture, mi.ParamFlags.Differentiable)

    def update(self, left_out: Collection[str]) -> None:
        """Take over the values as they are now; those left out are all 0."""
        for name, value in self.values.items():
            if name in left_out:
                # A literal, not data: ``dr.freeze`` tells by it that what it recorded does not hold for other values.
                value *= 0
            else:
                # Opaque: data of the compiled function, not part of its code, so materials can share it.
                dr.make_opaque(value)
        self.inside = {name: held(self._parameters[name], dr.detach(v)) for name, v in self.values.items()}
        dr.make_opaque({name: v for name, v in self.inside.items() if name not in left_out})
        self.literal = {}
        # As data, each of the hundreds of numbers would be gathered for every lane, which takes ten times as long.
        # While a function is recorded no value can be looked at.
        _literal.discard(self)
        few = len(_literal) < _MOST_LITERAL
        own = next((name for name in ("read_out", "code") if name in self.inside), None)
        if own and few and not dr.flag(dr.JitFlag.FreezingScope):
            _literal.add(self)
            numbers = self.inside[own].numpy()
            if own == "code" and self._trunk:  # of one material: a read-out is cheaper than the basis
                numbers = self._trunk.read_outs(numbers)
            self.literal["read_out"] = [mi.Float(v) for v in numbers.tolist()]
        if mi.is_spectral:
            self.spectra = {
                name: _upsample(mi.Color3f(self.inside[name])) for name in self._colours if name in self.values
            }

    def constants(self) -> dict:
        """Return the parameters that are the same everywhere, with RGB colours, held in range."""
        result = {}
        for name, value in self.values.items():
            if name in self.literal and not dr.grad_enabled(value):
                result[name] = self.literal[name]
                continue
            v: Any = value if dr.grad_enabled(value) else self.inside[name]
            # latent numbers apart before anything else: within a symbolic call lanes of their own are gathered
            if self._parameters[name].kind == "latent":
                v = [dr.gather(mi.Float, v, k) for k in range(len(v))]
            result[name] = held(self._parameters[name], v) if dr.grad_enabled(value) else v
        if "code" in self.values and "read_out" in self.literal and not dr.grad_enabled(self.values["code"]):
            result["read_out"] = self.literal["read_out"]
        return result

    def at(self, si: mi.SurfaceInteraction3f, active) -> dict:
        """Return all parameters at a hit point, with RGB colours, held in range: roughness 0 would give NaN."""
        params = self.constants()
        for name, texture in self.textures.items():
            if self._parameters[name].kind == "latent":
                value = texture.numbers(si, active)
            else:
                value = _rgb(texture, si, active) if name in self._colours else texture.eval_1(si, active)
            params[name] = held(self._parameters[name], value)
        return params

    def spectral(self, params: Mapping, si: mi.SurfaceInteraction3f, active) -> Mapping:
        """Return the parameters of :meth:`at` with colours in the representation of the variant."""
        if mi.is_rgb:
            return params
        colours = {}
        for name in params.keys() & set(self._colours):
            if name in self.textures:
                colours[name] = held(self._parameters[name], self.textures[name].eval(si, active))
            elif mi.is_monochromatic:
                colours[name] = mi.Color1f(mi.luminance(params[name]))
            else:
                texture, scale = self.spectra[name]
                colours[name] = texture.eval(si, active) * scale
        return {**params, **colours, "of_rgb": lambda rgb: _of_rgb(rgb, si)}

    def with_gradients(self, params: Mapping) -> Iterator[Any]:
        """Yield a number of each of the parameters of :meth:`at` that have gradients: the sum of its own."""
        for name, v in params.items():
            if name not in self.spectra and dr.grad_enabled(v):
                yield sum(v) if isinstance(v, (list, mi.Color3f)) else v


def _rgb(texture: mi.Texture, si: mi.SurfaceInteraction3f, active) -> mi.Color3f:
    """A textured colour as RGB, which is what the networks were trained on."""
    if mi.is_rgb:
        return mi.Color3f(texture.eval(si, active))
    if mi.is_monochromatic:
        return mi.Color3f(texture.eval(si, active).x)
    at = mi.SurfaceInteraction3f(si)
    at.wavelengths = type(si.wavelengths)(*_RGB_WAVELENGTHS, _RGB_WAVELENGTHS[1])
    return mi.Color3f(*list(texture.eval(at, active))[:3])


def _of_rgb(rgb: mi.Color3f, si: mi.SurfaceInteraction3f) -> Any:
    """A factor in RGB for the wavelengths of a hit point: linear between the peaks of the primaries."""
    if mi.is_monochromatic:
        return mi.Color1f(mi.luminance(rgb))
    red, green, blue = _RGB_WAVELENGTHS
    to_red = dr.clip((si.wavelengths - green) / (red - green), 0, 1)
    to_blue = dr.clip((si.wavelengths - green) / (blue - green), 0, 1)
    return rgb.y + to_red * (rgb.x - rgb.y) + to_blue * (rgb.z - rgb.y)


def _upsample(rgb: mi.Color3f) -> tuple[mi.Texture, float]:
    """A colour as a texture of the active variant and a factor; Mitsuba upsamples reflectances, at most 1."""
    value = [float(rgb[k][0]) for k in range(3)]
    scale = max(1.0, *value)
    texture = mi.load_dict({"type": "rgb", "value": [v / scale for v in value]})
    return texture, scale
