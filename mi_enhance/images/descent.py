"""Steps down the difference between a scene and photographs of it: Adam on gradients of Mitsuba's ``prb``."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
from drjit.opt import Adam

from ..system.garbage_collection import no_collection
from .image_loss import Measure
from .scene_materials import get, put
from .targets import Target
from .unknowns import Unknown

_LARGEST = 1e15  # of a derivative: Adam's square of it must stay within float32; a path that says more is an accident
_MEMORY = 8  # renders whose mean is what the scene looks like: fewer are noisy, more are old


class Descent:
    """A descent: the values that move, and the steps that move them. The scene holds the values of the last step.

    Parameters
    ----------
    scene : mi.Scene
    unknowns : sequence of Unknown
    light : Unknown or None
        If given, a factor of all that is rendered is sought, too.
    measure : Measure
    max_depth, seed : int
    """

    def __init__(
        self,
        scene: mi.Scene,
        unknowns: Sequence[Unknown],
        light: Unknown | None,
        measure: Measure,
        max_depth: int,
        seed: int,
    ):
        self.scene, self.unknowns, self.light, self.measure = scene, tuple(unknowns), light, measure
        self.params = mi.traverse(scene)
        self.curve: list[dict] = []  # step, seconds, loss
        self.nonfinite = 0  # components of gradients that were set to 0
        self.nonfinite_pixels = 0  # values of renders that were left out
        self.start = time.perf_counter()
        self._gradients = mi.load_dict({"type": "prb", "max_depth": max_depth})
        self._path = mi.load_dict({"type": "path", "max_depth": max_depth})
        self._seed = 1000 * seed
        values = {u.key: get(self.params, u.key) for u in self.unknowns}
        # Frozen: tracing a scene with networks takes longer than running it. Gradients of textures would get lost.
        is_textured = any(isinstance(self.params[u.key], mi.TensorXf) for u in self.unknowns)
        self._backward = self._trace_backward if is_textured else dr.freeze(self._trace_backward)
        self._primal = dr.freeze(lambda scene, *rest: self._trace_primal(scene, *rest))
        self.put(values | ({light.key: np.ones(1)} if light else {}))

    # ------------------------------------------------------------------ values

    def put(self, values: Mapping[str, np.ndarray]) -> None:
        """Go on from other values of some scene parameters, unknown or not; Adam forgets what it has seen."""
        moved = getattr(self, "_moved", {})
        known = {u.key: u for u in self._all()}
        for key, value in values.items():
            if key in known:
                size = moved[key].size if key in moved else np.size(value)
                moved[key] = known[key].space.to_free(np.broadcast_to(np.asarray(value, np.float64).ravel(), size))
            else:
                put(self.params, key, value)
        self._moved = moved
        # by id: the target, how many renders, and their mean, the last ones counting most
        self._seen: dict[int, tuple[Target, int, np.ndarray]] = {}
        self._adam = Adam(lr=1e-3, params={key: mi.Float(v.astype(np.float32)) for key, v in moved.items()})
        self._update(attach=False)

    def values(self) -> dict[str, np.ndarray]:
        """All unknowns, physical and flat."""
        return {u.key: u.space.to_physical(self._moved[u.key]) for u in self._all()}

    def _all(self) -> tuple[Unknown, ...]:
        return (*self.unknowns, self.light) if self.light else self.unknowns

    def _update(self, attach: bool) -> tuple[dict, mi.Float]:
        """Hand the values to the scene; return those that gradients arrive at, and the factor of the light."""
        self._hand_over(self.values(), attach)
        light = dr.opaque(
            mi.Float, float(self.light.space.to_physical(self._moved[self.light.key])[0]) if self.light else 1.0
        )
        if attach and self.light:
            dr.enable_grad(light)
        return {u.key: self.params[u.key] for u in self.unknowns}, light

    def _hand_over(self, values: Mapping[str, np.ndarray], attach: bool = False) -> None:
        for u in self.unknowns:
            put(self.params, u.key, values[u.key])
            value = self.params[u.key]
            dr.make_opaque(value)  # data of the compiled function, not part of its code
            if attach:
                dr.enable_grad(value)
            self.params[u.key] = value
        self.params.update()

    # ------------------------------------------------------------------ rendering

    def render(
        self, target: Target, spp: int, seed: int, *, instead: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Return the scene as the cameras of a target see it, (H, views * W, 3), with some unknowns at other values."""
        if instead:
            self._hand_over({**self.values(), **instead})
            try:
                return self.render(target, spp, seed)
            finally:
                self._hand_over(self.values())
        light = dr.opaque(mi.Float, float(self.values()[self.light.key][0]) if self.light else 1.0)
        with no_collection():
            return np.array(self._primal(self.scene, target.sensor, light, dr.opaque(mi.UInt32, seed), spp))

    def _trace_primal(self, scene, sensor, light, seed, spp: int):
        with dr.suspend_grad():
            return light * mi.render(scene, sensor=sensor, integrator=self._path, spp=spp, seed=seed)

    def _trace_backward(self, scene, values, sensor, image, weight, saturated, seen, light, seed, spp: int):
        # values and light are arguments although the scene knows them: gradients arrive there
        target = Target([], sensor, image, weight, saturated)
        # prb draws other random numbers for the gradient than for the image; the light's gradient is that of `seen`
        image = mi.render(scene, self.params, sensor=sensor, integrator=self._gradients, spp=spp, seed=seed)
        rendered = dr.detach(light) * image + (light / dr.detach(light) - 1) * seen
        dr.backward(self.measure.pull(rendered, seen, target))
        return dr.detach(rendered)

    def _finite(self, image: np.ndarray, instead) -> np.ndarray:
        """The image without values that are not finite, which are counted."""
        finite = np.isfinite(image)
        self.nonfinite_pixels += int((~finite).sum())
        return np.where(finite, image, instead).astype(np.float32)

    def _next_seed(self):
        self._seed += 1
        return dr.opaque(mi.UInt32, self._seed)

    # ------------------------------------------------------------------ steps

    def step(self, target: Target, spp: int, rate: float, *, hold_late: bool = False) -> np.ndarray:
        """Take a step against the gradient; return the mean of the last renders, whose loss is in the curve."""
        if id(target) not in self._seen:
            self._seen[id(target)] = (target, 1, self._finite(self.render(target, spp, self._seed), 0))
        _, n, seen = self._seen[id(target)]
        values, light = self._update(attach=True)
        with no_collection():
            image = self._backward(
                self.scene,
                values,
                target.sensor,
                target.image,
                target.weight,
                target.saturated,
                mi.TensorXf(seen),
                light,
                self._next_seed(),
                spp,
            )
        seen = seen + (self._finite(np.array(image), seen) - seen) / min(n + 1, _MEMORY)
        self._seen[id(target)] = (target, n + 1, seen)
        self._adam.set_learning_rate(rate)
        for u in self._all():
            gradient = np.array(dr.grad(light if u is self.light else values[u.key]), np.float64).ravel()
            moved = self._moved[u.key]
            if hold_late and u.is_late:
                gradient = np.zeros_like(moved)
            with np.errstate(invalid="ignore"):  # infinity times 0 is NaN, which is left out below
                slope = gradient * u.space.slope(moved)
            usable = np.abs(slope) < _LARGEST  # false for NaN, too
            self.nonfinite += int((~usable).sum())
            dr.set_grad(self._adam[u.key], mi.Float(np.where(usable, slope, 0).astype(np.float32)))
        self._adam.step()
        for u in self._all():
            low, high = u.space.bounds
            self._adam[u.key] = dr.clip(dr.detach(self._adam[u.key]), low, high)
            self._moved[u.key] = np.array(dr.detach(self._adam[u.key]), np.float64)
        seconds = time.perf_counter() - self.start
        loss = self.measure.loss(seen, target)
        self.curve.append({"step": len(self.curve) + 1, "seconds": seconds, "loss": loss})
        return seen

    def settle(self) -> None:
        """Hand the values of the last step to the scene, without gradients."""
        self._update(attach=False)
