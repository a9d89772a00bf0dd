"""Steps down the difference between a scene and photographs of it: Adam on gradients of Mitsuba's ``prb``."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np

from ..system.garbage_collection import no_collection
from .adam import Adam
from .image_loss import Measure
from .material_prior import MaterialPrior
from .plugin_tables import evaluated
from .scene_materials import get, put
from .targets import Target
from .unknowns import Unknown

_LARGEST = 1e15  # of a derivative: Adam's square of it must stay within float32; a path that says more is an accident
RECENT = 20  # iterations whose mean is the loss: one alone is a matter of chance
# A gradient costs as much as several renders, and needs fewer samples: its noise is averaged by Adam, that of a render
# decides how well the loss is weighed.
_GRADIENT_SHARE = 4
_NOT_RECORDED = (
    "fit_images(): Dr.Jit cannot record renders in this process, so each is traced anew, which takes longer. It "
    "compiles every BSDF that is alive, and one of this or another scene holds data that it does not find: Mitsuba's "
    "measured, or a network in a class of your own. Drop that scene and call gc.collect(), or fit in a process of its "
    "own."
)


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
    exposures : Unknown, optional
        If given, a factor of each photograph is sought, too. Their geometric mean is 1: the rest is the light's, or the
        material's.
    fitted : array of bool, optional
        Which photographs, by number, are fitted: those whose factors move. One if left out.
    prior : MaterialPrior, optional
        Pulls at what photographs do not tell.
    """

    def __init__(
        self,
        scene: mi.Scene,
        unknowns: Sequence[Unknown],
        light: Unknown | None,
        measure: Measure,
        max_depth: int,
        seed: int,
        exposures: Unknown | None = None,
        fitted: np.ndarray | None = None,
        prior: MaterialPrior | None = None,
    ):
        self.scene, self.unknowns, self.light, self.measure = scene, tuple(unknowns), light, measure
        self.exposures, self.fitted = exposures, np.ones(1, bool) if fitted is None else fitted
        self.prior = prior
        self.params = mi.traverse(scene)
        self.curve: list[dict] = []  # step, seconds, loss
        self.nonfinite = 0  # components of gradients that were set to 0
        self.nonfinite_pixels = 0  # values of renders that were left out
        self.start = time.perf_counter()
        self._gradients = mi.load_dict({"type": "prb", "max_depth": max_depth})
        self._path = mi.load_dict({"type": "path", "max_depth": max_depth})
        self._seed = 1000 * seed
        values = {u.key: get(self.params, u.key) for u in self.unknowns}
        # Gradients of textures would get lost in a frozen function.
        self._is_textured = any(isinstance(self.params[u.key], mi.TensorXf) for u in self.unknowns)
        self._frozen: dict[tuple, Callable] = {}
        if light:
            values[light.key] = np.ones(1)
        if exposures:
            values[exposures.key] = np.ones(len(self.fitted))
        self.put(values)

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
        self._adam = Adam()
        self._update(attach=False)

    def values(self) -> dict[str, np.ndarray]:
        """All unknowns, physical and flat."""
        return {u.key: u.space.to_physical(self._moved[u.key]) for u in self._all()}

    def state(self) -> dict[str, dict[str, np.ndarray]]:
        """Return what :meth:`restore` goes on from: arrays by key of the unknowns, and counts."""
        counts = np.array([self._seed, self.nonfinite, self.nonfinite_pixels])
        return {"moved": dict(self._moved), "adam": dict(self._adam.state), "counts": {"": counts}}

    def restore(self, state: Mapping[str, Mapping[str, np.ndarray]]) -> None:
        """Go on where another descent in the same scene was."""
        self._seed, self.nonfinite, self.nonfinite_pixels = (int(n) for n in state["counts"][""])
        self._moved, self._adam = dict(state["moved"]), Adam(state["adam"])
        self._update(attach=False)

    def _all(self) -> tuple[Unknown, ...]:
        return (*self.unknowns, *(u for u in (self.light, self.exposures) if u))

    def _update(self, attach: bool) -> dict:
        """Hand the values to the scene; return those that gradients arrive at, by key."""
        self._hand_over(self.values(), attach)
        return {u.key: self.params[u.key] for u in self.unknowns}

    def _brightness(self, target: Target) -> np.ndarray:
        """Return what the pixels of a render are to be multiplied by, (H, W, 1)."""
        values, factor = self.values(), np.ones((*target.numbers.shape, 1))
        if self.light:
            factor *= values[self.light.key]
        return factor * values[self.exposures.key][target.numbers][..., None] if self.exposures else factor

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

    def render(self, target: Target, spp: int, seed: int) -> np.ndarray:
        """Return the scene as the cameras of a target see it, (H, W, 3)."""
        return self.renders(target, spp, [seed])[0]

    def renders(
        self, target: Target, spp: int, seeds: Iterable[int], *, instead: Mapping[str, np.ndarray] | None = None
    ) -> list[np.ndarray]:
        """Return a render for each seed, with some unknowns of the scene at other values."""
        if instead:
            self._hand_over({**self.values(), **instead})
        function, brightness = self._compiled(self._trace_primal, target.image.shape, spp), self._brightness(target)
        try:
            with no_collection():
                images = (function(self.scene, target.sensor, dr.opaque(mi.UInt32, seed), spp) for seed in seeds)
                return [brightness * np.array(image) for image in images]
        finally:
            if instead:
                self._hand_over(self.values())

    def _compiled(self, function: Callable, shape: tuple[int, ...], spp: int) -> Callable:
        """Return a function that is traced once: tracing a scene with networks takes longer than running it.

        One for each size. ``dr.freeze`` does not see that of a film, and would replay what it has recorded for another.
        """
        key = function.__name__, shape, spp
        if key not in self._frozen:
            self._frozen[key] = _frozen(function)
        return self._frozen[key]

    def _trace_primal(self, scene, sensor, seed, spp: int):
        with dr.suspend_grad():
            return mi.render(scene, sensor=sensor, integrator=self._path, spp=spp, seed=seed)

    def _trace_backward(self, scene, values, sensor, pull, seed, spp: int):
        # values are an argument although the scene knows them: gradients arrive there
        self._gradients.render_backward(scene, values, pull, sensor, seed, spp)

    def _backward(self, values: dict, sensor, pull: np.ndarray, spp: int) -> None:
        """Have the derivatives of an image with the weights `pull` (H, W, 3) arrive at `values`."""
        nodes = [one for one in self.params.hierarchy if hasattr(one, "set_folded_apart")]
        apart = {f"apart{k}": node.set_folded_apart() for k, node in enumerate(nodes)}
        arguments = (
            self.scene,
            values | {key: array for key, array in apart.items() if array is not None},
            sensor,
            mi.TensorXf(evaluated(pull), pull.shape),
            dr.opaque(mi.UInt32, self._next_seed()),
            spp,
        )
        function = self._trace_backward
        with no_collection():
            if self._is_textured:
                function(*arguments)
            else:
                self._compiled(function, pull.shape, spp)(*arguments)
            for node in nodes:
                node.hand_on_gradients()

    def _of_factors(self, slope: np.ndarray, target: Target) -> dict[str, np.ndarray]:
        """Return the derivatives for the brightness of light and photographs, from those for the log of each pixel."""
        values, result = self.values(), {}
        if self.light:
            result[self.light.key] = slope.sum() / values[self.light.key]
        if self.exposures:
            own = np.bincount(target.numbers.ravel(), slope.ravel(), len(self.fitted))
            result[self.exposures.key] = own / values[self.exposures.key]
        return result

    def _render_finite(self, target: Target, spp: int) -> np.ndarray:
        """Return a new render; values that are not finite are counted, and are those of the photograph."""
        image = self.render(target, spp, self._next_seed())
        finite = np.isfinite(image)
        self.nonfinite_pixels += int((~finite).sum())
        return np.where(finite, image, target.image)

    def _next_seed(self) -> int:
        self._seed += 1
        return self._seed

    # ------------------------------------------------------------------ steps

    def step(self, target: Target, spp: int, rate: float, *, hold_late: bool = False) -> np.ndarray:
        """Take a step against the gradient; return the mean of two renders, whose loss is in the curve."""
        values = self._update(attach=True)
        # Independent of each other: what weighs the difference of a pixel must not know its noise.
        one, two = (self._render_finite(target, max(1, spp // 2)) for _ in range(2))
        pulls = [0.5 * self.measure.pull(a, b, target) for a, b in ((one, two), (two, one))]
        pull = sum(pulls) * self._brightness(target)
        self._backward(values, target.sensor, pull, max(1, spp // _GRADIENT_SHARE))
        gradients = {u.key: np.array(dr.grad(values[u.key]), np.float64).ravel() for u in self.unknowns}
        # the logarithm of a factor: a difference meets the render that it was not made of
        gradients |= self._of_factors((pulls[0] * two + pulls[1] * one).sum(-1, dtype=np.float64), target)
        if self.prior and self.curve:
            pulled = self.prior.gradients(self.values(), self.loss())
            gradients |= {key: gradients[key] + slope for key, slope in pulled.items()}
        for u in self._all():
            self._move(u, gradients[u.key], rate, hold_late and u.is_late)
        mean = (one + two) / 2
        seconds = time.perf_counter() - self.start
        loss = self.measure.loss(mean, target)
        self.curve.append({"step": len(self.curve) + 1, "seconds": seconds, "loss": loss})
        return mean

    def _move(self, u: Unknown, gradient: np.ndarray, rate: float, is_held: bool) -> None:
        moved = self._moved[u.key]
        if is_held:
            gradient = np.zeros_like(moved)
        with np.errstate(invalid="ignore"):  # infinity times 0 is NaN, which is left out below
            slope = gradient * u.space.slope(moved)
        usable = np.abs(slope) < _LARGEST  # false for NaN, too
        self.nonfinite += int((~usable).sum())
        moved = np.clip(self._adam.step(u.key, moved, np.where(usable, slope, 0), rate), *u.space.bounds)
        if u is self.exposures:
            moved = np.where(self.fitted, moved - moved[self.fitted].mean(), moved)
        self._moved[u.key] = moved

    def loss(self) -> float:
        """Return the mean loss of the last iterations."""
        return float(np.mean([row["loss"] for row in self.curve[-RECENT:]]))

    def settle(self) -> None:
        """Hand the values of the last step to the scene, without gradients."""
        self._update(attach=False)


def _frozen(function: Callable) -> Callable:
    """Return a function that ``dr.freeze`` records where it can, and that is traced at every call where it cannot."""
    recorded = dr.freeze(function)

    def call(*args):
        nonlocal recorded
        try:
            return recorded(*args)
        except RuntimeError as error:
            if not str(error).startswith("record()"):
                raise
            warnings.warn(_NOT_RECORDED)  # noqa: B028  (from one place: told once)
            recorded = function
            return function(*args)

    return call
