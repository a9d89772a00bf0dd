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

 * - latent, code
   - |exposed|, |differentiable|
   - The neural parameters; from the file, or from the maps.

 * - maps
   - |string|
   - Maps over the surface (OpenEXR, one channel for each number: ``rho_d.R``, ``alpha_x``, ``code.00``) of any
     parameters, made with the networks of ``filename``; written by ``MaterialMaps.save()``. A parameter that the scene
     gives as well is taken from the scene.

 * - filter_type, wrap_mode, to_uv
   - |string|, |string|, |transform|
   - As of Mitsuba's ``bitmap``, for all ``maps``: between the texels ``bilinear`` (default) or ``nearest``; outside of
     the unit square ``repeat`` (default), ``mirror`` or ``clamp``; texture coordinates are transformed by ``to_uv``.

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
an update of the parameters brings it back. A value out of range, whatever puts it in (``mi.traverse``, an optimizer, a
texture, a map), counts as the bound; its gradient is that at the bound, so an optimizer can come back. NaN stays NaN.
Unpolarized: in polarized variants it depolarizes. Under ``ptracer``, which comes from the light, viewer and light are
exchanged.
Reference: Shen et al., *Neural Enhancement of Analytical Appearance Models*.
"""

# Where types are ignored, the name is missing in Mitsuba's stubs, or of another type there.

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import mitsuba as mi
from mi_enhance.bsdfs import properties
from mi_enhance.bsdfs.compiled_form import CompiledForm, Form
from mi_enhance.bsdfs.sampled_lobes import SampledLobes
from mi_enhance.bsdfs.scene_parameters import SceneParameters

from mi_enhance.sampling import energy_bound, importance


class Enhanced(mi.BSDF):
    """The mi.BSDF adapter of a :class:`mi_enhance.Material`; see the module's text for its parameters.

    Parameters
    ----------
    props : mi.Properties
    reflectance : callable, optional
        ``reflectance(viewer, light) -> mi.Color3f``, evaluated in place of the material, which is still sampled; see
        :func:`mi_enhance.bsdfs.function.function_bsdf`.
    """

    def __init__(self, props: mi.Properties, reflectance: Callable | None = None):
        super().__init__(props)
        where = f'bsdf "enhanced" ("{self.id()}")'
        self.m_material = properties.material_of(props)
        self.m_reflectance = reflectance
        brdf = self.m_material.brdf
        self.m_compiled = CompiledForm(brdf, properties.evaluators_of(props))
        self.m_parameters = SceneParameters(props, self.m_material, where)
        self.m_energy = bool(props.get("energy", self.m_material.bound_energy))
        if self.m_energy:
            self.m_parameters.check_uniform(where)
        self.m_lobes = SampledLobes(self.m_material)
        # What a parameter without effect is multiplied by: data, for a literal 0 would take its gradient away.
        self.m_zero = dr.opaque(mi.Float, 0)
        varying = mi.BSDFFlags.SpatiallyVarying if self.m_parameters.textures else mi.BSDFFlags.Empty
        self.m_components = [
            mi.BSDFFlags.DiffuseReflection
            | mi.BSDFFlags.GlossyReflection
            | mi.BSDFFlags.Anisotropic
            | mi.BSDFFlags.FrontSide
            | varying
        ]
        self.m_flags = self.m_components[0]
        self._update()

    @property
    def material(self):
        """The material as it was loaded; what the scene has now is in ``mi.traverse``."""
        return self.m_material

    @property
    def textures(self) -> dict[str, mi.Texture]:
        """The textures by the name of their parameter; one texture may stand under several names."""
        return dict(self.m_parameters.textures)

    # ------------------------------------------------------------------ parameters

    def traverse(self, cb):
        self.m_parameters.traverse(cb)

    def parameters_changed(self, keys=()):
        self._update(keys)

    def _update(self, keys=()) -> None:
        """Take over the values of the parameters as they are now."""
        self.m_compiled.choose(self.m_parameters.values, keys)
        left_out = self.m_compiled.form.left_out
        self.m_parameters.update(left_out)
        # Detached: `prb` hands gradients to the parameters themselves, never to what was computed from them before.
        constants = dr.detach(self.m_parameters.constants())
        self.m_compiled.fold(constants, self.m_parameters.textures)
        self.m_lobes.update(self.m_compiled.form, constants, self.m_parameters.textures)
        if self.m_energy:
            # a colour from a scene is a texture, too
            params = dr.detach(self.m_parameters.at(dr.zeros(mi.SurfaceInteraction3f), True))
            params = {name: v for name, v in params.items() if name not in left_out}
            lobe_albedo = dr.opaque(mi.Float, self.m_material.lobe_albedo)
            self.m_bound = energy_bound.table(self.m_compiled.form.brdf, params, lobe_albedo)

    def _prepare(self, si: mi.SurfaceInteraction3f, active) -> tuple[Form, dict, dict, dict]:
        """Return what is evaluated, the parameters it reads at the hit point, all of them, and what is folded."""
        everything = self.m_parameters.at(si, active)
        form, folded = self.m_compiled.at(everything, self.m_parameters.values, self.m_parameters.textures)
        params = {name: v for name, v in everything.items() if name not in form.left_out}
        return form, params, everything, folded

    def set_folded_apart(self) -> mi.Float | None:
        """Have gradients arrive at what is folded of the parameters into the networks, in place of the parameters.

        A vertex of a path then hands on half as much: what is folded need not be computed there once more, nor taken
        back. :meth:`hand_on_gradients` does that, once. An update of the parameters ends it.

        Returns
        -------
        mi.Float or None
            None where a map makes it vary: gradients arrive at the parameters as ever.
        """
        return self.m_compiled.set_apart()

    def hand_on_gradients(self) -> None:
        """Add to the gradients of the parameters what has arrived since :meth:`set_folded_apart`."""
        self.m_compiled.hand_on(self.m_parameters.constants())

    # ------------------------------------------------------------------ evaluation

    def _active(self, ctx, si, active):
        if not any(ctx.is_enabled(f, 0) for f in (mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.GlossyReflection)):
            return mi.Mask(False)  # type: ignore[operator]
        return mi.Mask(active) & (mi.Frame3f.cos_theta(si.wi) > 0)  # type: ignore[operator]

    def _eval(self, ctx, si, wo, prepared, active):
        """Return f cos of the light for the unpolarized spectrum of the variant."""
        form, params, everything, folded = prepared
        # What comes from the light (`ptracer`) meets the viewer in wo.
        viewer, light = (wo, si.wi) if ctx.mode == mi.TransportMode.Importance else (si.wi, wo)
        if self.m_reflectance is not None:
            return dr.select(active, self.m_reflectance(viewer, light) * mi.Frame3f.cos_theta(wo), 0)
        value = form.brdf(viewer, light, self.m_parameters.spectral(params, si, active), form.evaluators, folded)
        if self.m_energy:
            value = energy_bound.bounded(value, self.m_bound, viewer, light, params)
        value += self._no_effect(everything)
        return dr.select(active, value * mi.Frame3f.cos_theta(wo), 0)

    def _pdf(self, si, wo, prepared, active):
        form, params, *_ = prepared
        model, shares = self.m_lobes.at(si, form, params)
        return dr.select(active, importance.pdf(si.wi, wo, params, shares, model), 0)

    def eval(self, ctx, si, wo, active=True):
        active = self._active(ctx, si, active) & (mi.Frame3f.cos_theta(wo) > 0)
        return _depolarized(self._eval(ctx, si, wo, self._prepare(si, active), active))

    def pdf(self, ctx, si, wo, active=True):
        active = self._active(ctx, si, active) & (mi.Frame3f.cos_theta(wo) > 0)
        return self._pdf(si, wo, self._prepare(si, active), active)

    def eval_pdf(self, ctx, si, wo, active=True):
        active = self._active(ctx, si, active) & (mi.Frame3f.cos_theta(wo) > 0)
        prepared = self._prepare(si, active)
        return _depolarized(self._eval(ctx, si, wo, prepared, active)), self._pdf(si, wo, prepared, active)

    def sample(self, ctx, si, sample1, sample2, active=True):
        active = self._active(ctx, si, active)
        prepared = self._prepare(si, active)
        form, params, *_ = prepared
        bs = mi.BSDFSample3f()
        model, shares = self.m_lobes.at(si, form, params)
        bs.wo = importance.sample(si.wi, params, shares, sample1, sample2, model)
        active &= mi.Frame3f.cos_theta(bs.wo) > 0
        bs.pdf = self._pdf(si, bs.wo, prepared, active)
        active &= bs.pdf > 0
        bs.eta = 1  # type: ignore[assignment]
        bs.sampled_type = mi.UInt32(int(mi.BSDFFlags.GlossyReflection))  # type: ignore[assignment]
        bs.sampled_component = mi.UInt32(0)  # type: ignore[assignment]
        value = self._eval(ctx, si, bs.wo, prepared, active)
        return bs, _depolarized(dr.select(active, value / bs.pdf, 0))

    def eval_diffuse_reflectance(self, si, active=True):
        """Albedo of the diffuse term: pi M."""
        form, params, everything, folded = self._prepare(si, active)
        if "M" not in form.brdf.model.graph.slots:  # rho_d is 0
            return mi.Spectrum(self._no_effect(everything))
        up = mi.Vector3f(0, 0, 1)
        params = self.m_parameters.spectral(params, si, active)
        graph, record, _ = form.brdf.prepare(up, up, params, form.evaluators, folded)
        return mi.Spectrum(graph.find("M")(record) * dr.pi + self._no_effect(everything))

    def _no_effect(self, everything) -> mi.Float:
        """Return 0 with the gradient 0 of every parameter: one without effect would have none."""
        return sum((self.m_zero * v for v in self.m_parameters.with_gradients(everything)), mi.Float(0))

    def to_string(self):
        lines = self.m_material.show().splitlines()
        return "Enhanced[\n  " + "\n  ".join(lines) + "\n]"


def _depolarized(value) -> mi.Spectrum:
    """Return what leaves the surface: unpolarized light, as of Mitsuba's own rough plugins."""
    return mi.mueller.depolarizer(mi.UnpolarizedSpectrum(value)) if mi.is_polarized else mi.Spectrum(value)
