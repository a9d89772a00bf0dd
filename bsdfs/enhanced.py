r"""
.. _bsdf-enhanced:

Enhanced analytical BRDF (:monosp:`enhanced`)
---------------------------------------------

.. pluginparameters::

 * - filename
   - |string|
   - A material written by ``mi-enhance fit`` or ``Material.save()``. Relative paths are looked up beside the scene.

 * - rho_d, rho_s
   - |spectrum| or |texture|
   - Diffuse and specular albedo, instead of the file's.
   - |exposed|, |differentiable|

 * - alpha_x, alpha_y, F0, n_x, n_y, t_theta
   - |float| or |texture|
   - Roughness along tangent and bitangent, reflectance at normal incidence, tilt of the normal, rotation of the tangent
     (radians), instead of the file's.
   - |exposed|, |differentiable|

 * - rho_s2, alpha_x2, alpha_y2
   - as above
   - The second lobe of model ``ggx2``.
   - |exposed|, |differentiable|

 * - asymmetry
   - |float| or |texture|
   - How far the networks tell viewer from light, for materials that have it (``ggx2``); 0 is exactly reciprocal.
   - |exposed|, |differentiable|

 * - A
   - |spectrum| or |texture|
   - Height of the highlight of model ``abc``, which has it in place of rho_s, instead of the file's.
   - |exposed|, |differentiable|

 * - B, C, ior
   - |float| or |texture|
   - Shape of the highlight and index of refraction of model ``abc``, instead of the file's.
   - |exposed|, |differentiable|

 * - n_u, n_v
   - |float| or |texture|
   - Exponents along tangent and bitangent of model ``ashikhmin_shirley``, instead of the file's.
   - |exposed|, |differentiable|

 * - evaluators
   - |string|
   - How networks are evaluated: ``baked`` (weights as float32 constants of the compiled function) or ``cooperative``
     (cooperative vectors: half precision on tensor cores with CUDA, float32 elsewhere). Default: ``cooperative`` with
     CUDA, ``baked`` elsewhere, where it is 4 to 15 times faster.

 * - energy
   - |bool|
   - Hold the directional albedo at 1 or below for every view, whatever the parameters are. Default: what the file says.
     No parameter may be textured then.

 * - latent
   - |exposed|, |differentiable|
   - The neural parameters; from the file, or from the maps.

 * - maps
   - |string|
   - Maps over the surface (OpenEXR, one channel for each number: ``rho_d.R``, ``alpha_x``, ``latent.00``) of any
     parameters, made with the networks of ``filename``; written by ``MaterialMaps.save()``. A parameter that the scene
     gives as well is taken from the scene.

 * - filter_type
   - |string|
   - Between the texels of ``maps``: ``bilinear`` (default) or ``nearest``.

An analytic reflectance model, some of whose terms or operators are small neural networks, fitted to a measured
material.

.. tabs::
    .. code-tab:: xml

        <bsdf type="enhanced">
            <string name="filename" value="gold.bsdf"/>
            <rgb name="rho_d" value="0.2, 0.1, 0"/>   <!-- optional: edits the material -->
        </bsdf>

    .. code-tab:: python

        'type': 'enhanced',
        'filename': 'gold.bsdf'

One-sided, like all opaque BSDFs of Mitsuba; wrap it in ``twosided`` if needed. Works in every JIT variant; the networks
see RGB parameters in all of them, colour enters through rho_d, rho_s and rho_s2. In spectral variants RGB values are
upsampled as Mitsuba does it, without gradients. Sampling: visible GGX normals and cosine, exact density. Weights are
constants of the compiled function; what belongs to a material is data, so materials of one network share that function.
What is 0 and neither textured nor optimized is left out of it: a colour with its whole term, the frame, ``asymmetry``;
an update of the parameters brings it back.
Reference: Shen et al., *Neural Enhancement of Analytical Appearance Models*.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from mi_enhance.analytic import parameters
from mi_enhance.analytic.models.model import Model
from mi_enhance.material.material import Material
from mi_enhance.material.material_maps import MaterialMaps
from mi_enhance.neural import baked, cooperative
from mi_enhance.neural.enhanced_brdf import EnhancedBRDF
from mi_enhance.neural.simplify import simplify
from mi_enhance.sampling import energy_bound, importance, lobe_mixture

# Wavelengths (nm) at which a textured spectrum is read as RGB for the networks: near the peaks of the sRGB primaries.
_RGB_WAVELENGTHS = (611.0, 549.0, 465.0)


class _Form(NamedTuple):
    """A BRDF from which something may be left out, and how it is evaluated."""

    brdf: EnhancedBRDF
    evaluators: dict
    left_out: frozenset[str]  # names of parameters, all 0, that it is evaluated without


class LatentMap(mi.Texture):
    """A bitmap of as many channels as there are latent numbers; Mitsuba's own has one or three."""

    def __init__(self, data: mi.TensorXf, filter_type: str):
        super().__init__(mi.Properties())
        modes = {"bilinear": dr.FilterMode.Linear, "nearest": dr.FilterMode.Nearest}
        # Not in texture memory, which a GPU has for up to four channels, and whose values have no gradients.
        self.m_texture = mi.Texture2f(
            data, use_accel=False, migrate=False, filter_mode=modes[filter_type], wrap_mode=dr.WrapMode.Repeat
        )

    def traverse(self, cb):
        cb.put("data", self.m_texture.tensor(), mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        self.m_texture.update_inplace()

    def numbers(self, si: mi.SurfaceInteraction3f, active) -> list[mi.Float]:
        """All of them at the hit point."""
        return self.m_texture.eval(si.uv, active)

    def is_spatially_varying(self):
        return True

    def to_string(self):
        return f"LatentMap[{self.m_texture.shape}]"


class Enhanced(mi.BSDF):
    """The mi.BSDF adapter of a :class:`mi_enhance.Material`; see the module's text for its parameters."""

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        self.m_material = _material(props)
        self.m_brdf = self.m_material.brdf
        coloured = [slot for slot, mlp in self.m_brdf.modules.items() if mlp.sizes[-1] == 3]
        if coloured and not mi.is_rgb:
            raise ValueError(
                f'bsdf "enhanced": the networks for {", ".join(coloured)} give RGB, which variant "{mi.variant()}" '
                "does not render. Use an rgb variant, or a network that leaves these terms analytic."
            )
        self.m_evaluators = _evaluators(props)
        self.m_forms, self.m_known = {}, {}
        self.m_full = self._form(self.m_brdf, frozenset())
        self.m_stored = self.m_brdf.evaluators(baked.Stored)
        self.m_values, self.m_textures = {}, _maps(props, self.m_material)
        self.m_colours = [p.name for p in self.m_brdf.parameters if p.is_colour]
        for p in self.m_brdf.parameters:
            self._read(props, p)
        self.m_energy = bool(props.get("energy", self.m_material.bound_energy))
        if self.m_energy:
            self._check_textures()
        self.m_lobe_albedo = mi.Float(self.m_material.lobe_albedo)
        mixture = self.m_material.mixture
        self.m_scales = [mi.Float(c) for c in mixture.scales] if mixture else []
        self.m_albedos = mi.Float(np.ravel(mixture.albedos)) if mixture else mi.Float(0)
        dr.make_opaque(self.m_scales, self.m_albedos)
        varying = mi.BSDFFlags.SpatiallyVarying if self.m_textures else mi.BSDFFlags.Empty
        self.m_components = [
            mi.BSDFFlags.DiffuseReflection
            | mi.BSDFFlags.GlossyReflection
            | mi.BSDFFlags.Anisotropic
            | mi.BSDFFlags.FrontSide
            | varying
        ]
        self.m_flags = self.m_components[0]
        self._update()

    def _read(self, props: mi.Properties, p: parameters.Parameter) -> None:
        """Take a parameter from the scene, else from the file."""
        value = self.m_material.params[p.name]
        if p.name not in props and p.name in self.m_textures:
            return
        if p.name in props and p.name != "latent":
            self.m_textures.pop(p.name, None)
            given, where = props[p.name], f'bsdf "enhanced" ("{self.id()}")'
            is_spectrum = p.name in self.m_colours and props.type(p.name) == mi.Properties.Type.Spectrum
            if is_spectrum or isinstance(given, mi.Texture):
                self.m_textures[p.name] = props.get_unbounded_texture(p.name)
                return
            try:
                numbers = np.atleast_1d(np.asarray(given, np.float64)).ravel()
            except (TypeError, ValueError):
                what = "a colour, spectrum" if p.name in self.m_colours else "a number"
                raise TypeError(f"{where}: {p.name} must be {what} or texture; got {given!r}.") from None
            value = parameters.check([p], {p.name: numbers}, where)[p.name]
        self.m_values[p.name] = mi.Color3f(value) if p.is_colour else mi.Float(value)

    def _check_textures(self) -> None:
        """Raise where the table of one material would have to bound the energy of all that a texture makes of it."""
        wrong = sorted(name for name, texture in self.m_textures.items() if texture.is_spatially_varying())
        if wrong:
            raise ValueError(
                f'bsdf "enhanced" ("{self.id()}"): energy is bounded for one material at a time; {", ".join(wrong)} '
                "must not be textured here. Give a value, or set energy to false."
            )

    # ------------------------------------------------------------------ parameters

    def traverse(self, cb):
        for name, value in self.m_values.items():
            if self.m_brdf.distilled and (name == "latent" or name.startswith("norm_")):
                continue  # a specialized material has them in the weights of its own network
            # Upsampling to spectra is not differentiable.
            flag = mi.ParamFlags.NonDifferentiable if name in self.m_spectra else mi.ParamFlags.Differentiable
            cb.put(name, value, flag)
        for name, texture in self.m_textures.items():
            cb.put(name, texture, mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys=()):
        self._update(keys)

    def _update(self, keys=()) -> None:
        """Choose what is left out; fold what is constant over the surface into the networks' first layers."""
        self._know(keys)
        self.m_simple = self._form(*simplify(self.m_brdf, self.m_known))
        for name, value in self.m_values.items():
            if name in self.m_simple.left_out:
                # A literal, not data: ``dr.freeze`` tells by it that what it recorded does not hold for other values.
                value *= 0
            else:
                # Opaque: data of the compiled function, not part of its code, so materials can share it.
                dr.make_opaque(value)
        dr.make_opaque(self.m_lobe_albedo)
        self.m_spectra = {}
        if mi.is_spectral:
            self.m_spectra = {name: _upsample(self.m_values[name]) for name in self.m_colours if name in self.m_values}
        # Detached: `prb` hands gradients to the parameters themselves, never to what was computed from them before.
        constants = dr.detach(self._constants())
        self.m_folded = self.m_begun = self.m_shares = None
        read = self.m_brdf.read_by_networks
        if not self.m_textures.keys() & set(read):
            self.m_folded = self.m_brdf.fold(constants, self.m_stored)
            dr.make_opaque(self.m_folded)
        else:
            self.m_begun = self.m_brdf.begin_fold(_parts(self.m_brdf, constants, self.m_values), self.m_stored)
            dr.make_opaque(self.m_begun)
        if not self.m_textures and not self.m_scales:
            present = {name: v for name, v in constants.items() if name not in self.m_simple.left_out}
            self.m_shares = lobe_mixture.shares(present, self.m_lobe_albedo, self.m_brdf.model)
            dr.make_opaque(self.m_shares)
        if self.m_energy:
            self.m_bound = self._bound(constants)

    def _bound(self, constants: dict) -> mi.Float:
        """The table of :mod:`mi_enhance.sampling.energy_bound` for the parameters as they are."""
        form, values, si = self.m_simple, dict(constants), dr.zeros(mi.SurfaceInteraction3f)
        for name, texture in self.m_textures.items():  # a colour from a scene is a texture, too
            values[name] = dr.detach(_rgb(texture, si, True) if name in self.m_colours else texture.eval_1(si))
        values = {name: v for name, v in values.items() if name not in form.left_out}
        shares = lobe_mixture.shares(values, self.m_lobe_albedo, form.brdf.model)
        return energy_bound.table(form.brdf, values, shares)

    def _know(self, keys) -> None:
        """Keep the values of the parameters that are the same everywhere and not being optimized."""
        if dr.flag(dr.JitFlag.FreezingScope):
            self.m_known = {}  # while a function is recorded no value can be looked at
            return
        self.m_known = {
            name: self.m_known[name] if keys and name in self.m_known and name not in keys else dr.detach(value).numpy()
            for name, value in self.m_values.items()
            if not dr.grad_enabled(value)
        }

    def _form(self, brdf: EnhancedBRDF, left_out: frozenset[str]) -> _Form:
        """Made once for everything that may be left out."""
        if left_out not in self.m_forms:
            self.m_forms[left_out] = _Form(brdf, brdf.evaluators(self.m_evaluators), left_out)
        return self.m_forms[left_out]

    def _constants(self) -> dict:
        values = dict(self.m_values)
        if "latent" in values:
            latent = values["latent"]
            values["latent"] = [dr.gather(mi.Float, latent, k) for k in range(len(latent))]
        return values

    def _prepare(self, si: mi.SurfaceInteraction3f, active) -> tuple[_Form, dict, dict]:
        """What is evaluated, the parameters at the hit point, with RGB colours, and what is folded of them."""
        form = self.m_simple
        if dr.grad_enabled([self.m_values[name] for name in form.left_out]):
            form = self.m_full  # optimized since the last update: nothing may be missing
        params = self._constants()
        for p in self.m_brdf.parameters:
            if p.name in self.m_textures:
                params[p.name] = self._textured(p, si, active)
        folded, read = self.m_folded, form.brdf.read_by_networks
        if dr.grad_enabled([params[name] for name in read if name in self.m_values]):
            folded = form.brdf.fold(params, form.evaluators)
        elif folded is None:  # what is the same everywhere has been folded before
            textured = _parts(self.m_brdf, params, self.m_textures)
            folded = form.brdf.fold(textured, form.evaluators, self.m_begun)
        return form, {name: v for name, v in params.items() if name not in form.left_out}, folded

    def _textured(self, p: parameters.Parameter, si: mi.SurfaceInteraction3f, active):
        """A parameter that varies, at the hit point. A texture may hold anything: roughness 0 would give NaN."""
        texture = self.m_textures[p.name]
        if isinstance(texture, LatentMap):
            return [dr.clip(v, p.low, p.high) for v in texture.numbers(si, active)]
        value = _rgb(texture, si, active) if p.name in self.m_colours else texture.eval_1(si, active)
        return dr.clip(value, p.low, p.high)

    def _spectral(self, params: dict, si: mi.SurfaceInteraction3f, active) -> dict:
        """The parameters with colours in the representation of the variant."""
        if mi.is_rgb:
            return params
        colours = {}
        for name in params.keys() & set(self.m_colours):
            if name in self.m_textures:
                colours[name] = self.m_textures[name].eval(si, active)
            elif mi.is_monochromatic:
                colours[name] = mi.Color1f(mi.luminance(self.m_values[name]))
            else:
                texture, scale = self.m_spectra[name]
                colours[name] = texture.eval(si, active) * scale
        return {**params, **colours}

    # ------------------------------------------------------------------ evaluation

    def _active(self, ctx, si, active):
        if not any(ctx.is_enabled(f, 0) for f in (mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.GlossyReflection)):
            return mi.Mask(False)
        return mi.Mask(active) & (mi.Frame3f.cos_theta(si.wi) > 0)

    def _eval(self, si, wo, form, params, folded, active):
        value = form.brdf(si.wi, wo, self._spectral(params, si, active), form.evaluators, folded)
        if self.m_energy:
            value *= energy_bound.factor(self.m_bound, si.wi, params) * energy_bound.factor(self.m_bound, wo, params)
        return dr.select(active, value * mi.Frame3f.cos_theta(wo), 0)

    def _mixture(self, si, form, params) -> tuple[Model, list]:
        """The model whose lobes are sampled, and their probabilities."""
        model = form.brdf.model
        if self.m_scales:
            shares = lobe_mixture.shares_at(si.wi.z, params, self.m_albedos, model)
            return lobe_mixture.scaled(model, list(enumerate(self.m_scales))), shares
        # from the last update where they cannot have changed
        known = form is self.m_simple and self.m_shares is not None and not dr.grad_enabled(params)
        return model, self.m_shares if known else lobe_mixture.shares(params, self.m_lobe_albedo, model)

    def _pdf(self, si, wo, form, params, active):
        model, shares = self._mixture(si, form, params)
        return dr.select(active, importance.pdf(si.wi, wo, params, shares, model), 0)

    def eval(self, ctx, si, wo, active=True):
        active = self._active(ctx, si, active) & (mi.Frame3f.cos_theta(wo) > 0)
        return mi.Spectrum(self._eval(si, wo, *self._prepare(si, active), active))

    def pdf(self, ctx, si, wo, active=True):
        active = self._active(ctx, si, active) & (mi.Frame3f.cos_theta(wo) > 0)
        form, params, _ = self._prepare(si, active)
        return self._pdf(si, wo, form, params, active)

    def eval_pdf(self, ctx, si, wo, active=True):
        active = self._active(ctx, si, active) & (mi.Frame3f.cos_theta(wo) > 0)
        form, params, folded = self._prepare(si, active)
        return mi.Spectrum(self._eval(si, wo, form, params, folded, active)), self._pdf(si, wo, form, params, active)

    def sample(self, ctx, si, sample1, sample2, active=True):
        active = self._active(ctx, si, active)
        form, params, folded = self._prepare(si, active)
        bs = mi.BSDFSample3f()
        model, shares = self._mixture(si, form, params)
        bs.wo = importance.sample(si.wi, params, shares, sample1, sample2, model)
        active &= mi.Frame3f.cos_theta(bs.wo) > 0
        bs.pdf = self._pdf(si, bs.wo, form, params, active)
        active &= bs.pdf > 0
        bs.eta = 1
        bs.sampled_type = mi.UInt32(int(mi.BSDFFlags.GlossyReflection))
        bs.sampled_component = mi.UInt32(0)
        value = self._eval(si, bs.wo, form, params, folded, active)
        return bs, mi.Spectrum(dr.select(active, value / bs.pdf, 0))

    def eval_diffuse_reflectance(self, si, active=True):
        """Albedo of the diffuse term: pi M."""
        form, params, folded = self._prepare(si, active)
        if "M" not in form.brdf.model.graph.slots:  # rho_d is 0
            return dr.zeros(mi.Spectrum)
        up = mi.Vector3f(0, 0, 1)
        params = self._spectral(params, si, active)
        graph, record, _ = form.brdf.prepare(up, up, params, form.evaluators, folded)
        return mi.Spectrum(graph.find("M")(record) * dr.pi)

    def to_string(self):
        lines = self.m_material.show().splitlines()
        return "Enhanced[\n  " + "\n  ".join(lines) + "\n]"


def _material(props: mi.Properties) -> Material:
    """From a file, or from the arrays of ``Material.to_dict()``."""
    if "filename" in props:
        if "weights" in props:
            raise ValueError('bsdf "enhanced": give filename or weights, not both.')
        return Material.load(str(mi.file_resolver().resolve(props["filename"])))
    if "description" not in props:
        raise ValueError('bsdf "enhanced": the parameter "filename" is missing. Name a file made by mi-enhance fit.')
    return Material.from_arrays(props["description"], props["params"], props["weights"])


def _maps(props: mi.Properties, material: Material) -> dict[str, mi.Texture]:
    """Textures of the parameters that vary: from a file, or from the arrays of ``MaterialMaps.to_dict()``."""
    if "maps" not in props:
        return {}
    where, filter_type = 'bsdf "enhanced"', props.get("filter_type", "bilinear")
    if filter_type not in ("bilinear", "nearest"):
        raise ValueError(f'{where}: filter_type "{filter_type}" is unknown. Choose bilinear or nearest.')
    if not mi.is_rgb:
        raise ValueError(
            f'{where}: maps hold linear RGB, which variant "{mi.variant()}" does not render. Use an rgb one.'
        )
    if isinstance(props["maps"], str):
        maps = MaterialMaps.load(str(mi.file_resolver().resolve(props["maps"])), material)
    else:
        maps = MaterialMaps.from_arrays(material, props["channels"], np.array(props["maps"]))
    result = {}
    for name, values in maps.maps.items():
        if name == "latent":
            result[name] = LatentMap(mi.TensorXf(values), filter_type)
        else:
            bitmap = {"type": "bitmap", "data": mi.TensorXf(values), "raw": True, "filter_type": filter_type}
            result[name] = mi.load_dict(bitmap)
    return result


def _evaluators(props: mi.Properties) -> type:
    """What evaluates the networks: asked for, or the faster one of the backend."""
    kinds = {"baked": baked.Baked, "cooperative": cooperative.Cooperative}
    name = props.get("evaluators", "cooperative" if dr.backend_v(mi.Float) == dr.JitBackend.CUDA else "baked")
    if name not in kinds:
        raise ValueError(f'bsdf "enhanced": evaluators "{name}" is unknown. Choose one of: {", ".join(kinds)}.')
    return kinds[name]


def _parts(brdf: EnhancedBRDF, params: dict, names: Collection[str]) -> dict:
    """Parameters in which all but `names` are unknown, as :meth:`EnhancedBRDF.begin_fold` takes them."""
    listed = lambda p: p.is_colour or p.name == "latent"  # noqa: E731
    unknown = {p.name: [None] * p.size if listed(p) else None for p in brdf.parameters}
    return unknown | {name: params[name] for name in names}


def _rgb(texture: mi.Texture, si: mi.SurfaceInteraction3f, active) -> mi.Color3f:
    """A textured colour as RGB, which is what the networks were trained on."""
    if mi.is_rgb:
        return mi.Color3f(texture.eval(si, active))
    if mi.is_monochromatic:
        return mi.Color3f(texture.eval(si, active).x)
    at = mi.SurfaceInteraction3f(si)
    at.wavelengths = type(si.wavelengths)(*_RGB_WAVELENGTHS, _RGB_WAVELENGTHS[1])
    return mi.Color3f(*list(texture.eval(at, active))[:3])


def _upsample(rgb: mi.Color3f) -> tuple[mi.Texture, float]:
    """A colour as a texture of the active variant and a factor; Mitsuba upsamples reflectances, at most 1."""
    value = [float(rgb[k][0]) for k in range(3)]
    scale = max(1.0, *value)
    texture = mi.load_dict({"type": "rgb", "value": [v / scale for v in value]})
    return texture, scale
