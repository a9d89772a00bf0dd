"""What a material does not need is left out of the kernel, exactly, and comes back when it is needed."""

from __future__ import annotations

import dataclasses
import functools
import gc

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from plugin_scenes import ball, bitmap, close, directions, evaluate, hit, vectors

from mi_enhance.material.material import Material
from mi_enhance.neural import baked, cooperative, mlp
from mi_enhance.neural.enhance import enhance
from mi_enhance.neural.simplify import simplify
from mi_enhance.neural.trainable import Trainable

N = 500
FRAME = {"n_x": 0, "n_y": 0, "t_theta": 0}
SHAPE = {"alpha_x": 0.3, "alpha_y": 0.2, "alpha_x2": 0.5, "alpha_y2": 0.6, "F0": 0.3}


@functools.lru_cache
def networks():
    """Small random weights: what is left out does not depend on how good the networks are."""
    b = enhance("ggx2", ("B", "G", "G2"), inputs="shape", modulated=True, n_latent=4, hidden=(8, 8), seed=1)
    return dataclasses.replace(b, modules=mlp.unflatten(b.modules, 0.3 * mlp.flatten(b.modules)))


def material(**values):
    """Everything is needed: no parameter is 0."""
    full = {"n_x": 0.1, "n_y": -0.05, "t_theta": 0.7, "asymmetry": 0.8, "rho_d": (0.3, 0.2, 0.1)}
    return Material(networks(), {**full, **SHAPE, "rho_s": (0.5, 0.4, 0.2), "rho_s2": 0.3, **values})


def operations(bsdf, method="eval") -> int:
    """Operations of the kernel that calls a method of a BSDF through a pointer, as a renderer does.

    Dr.Jit compiles every BSDF there is into such a kernel: no other one may be alive.
    """
    si, wo = hit(directions(N)), vectors(directions(N, seed=1))
    other = mi.load_dict({"type": "diffuse"})  # a single instance would be called without any dispatch
    target = dr.select(dr.arange(mi.UInt32, N) < N - 1, mi.BSDFPtr(bsdf), mi.BSDFPtr(other))
    dr.eval(si, wo, target)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        dr.eval(getattr(target, method)(mi.BSDFContext(), si, wo, mi.Mask(True)))
        return max(k["operation_count"] for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT)


ZEROS = {
    "frame": FRAME,
    "diffuse": {"rho_d": 0},
    "first": {"rho_s": 0},
    "second": {"rho_s2": 0},
    "asymmetry": {"asymmetry": 0},
    "only diffuse": {"rho_s": 0, "rho_s2": 0},
    "only second": {"rho_d": 0, "rho_s": 0, **FRAME, "asymmetry": 0},
    "nothing left": {"rho_d": 0, "rho_s": 0, "rho_s2": 0},
}


@pytest.mark.parametrize("name", ZEROS)
def test_what_is_left_has_the_same_values(llvm, name):
    m = material(**ZEROS[name])
    wi, wo = directions(N), directions(N, seed=1)
    b = m.bsdf()
    close(evaluate(b, wi, wo), m.evaluate(wi, wo) * wo[:, 2:])
    ctx, si = mi.BSDFContext(), hit(wi)
    close(np.array(b.eval_pdf(ctx, si, vectors(wo))[1]), np.array(b.pdf(ctx, si, vectors(wo))))
    assert operations(b) < operations(material().bsdf()) or name == "nothing left"


def test_each_branch_is_gone_with_its_network(llvm):
    """A network here has 11 * 8 + 8 * 8 + 8 products; an operation each, and a literal for the weights."""
    full, network = operations(material().bsdf()), 8 * 11 + 8 * 8
    for name in ("diffuse", "first", "second"):
        assert operations(material(**ZEROS[name]).bsdf()) < full - 2 * network
    assert operations(material(**ZEROS["only diffuse"]).bsdf()) < full - 4 * network
    assert operations(material(**ZEROS["asymmetry"]).bsdf()) < full - 3 * 2 * 8 * 2  # two inputs of eight units
    assert operations(material(**FRAME).bsdf()) < full - 50


def test_equation_of_what_is_left(llvm):
    m = material(rho_s=0, **FRAME)
    brdf, left_out = simplify(m.brdf, m.params)
    assert str(brdf) == "M * [B] + S2 * D2 * F2 * [G2] * 1/E2"
    assert left_out == {"rho_s", "n_x", "n_y", "t_theta"} and set(brdf.modules) == {"B", "G2"}
    assert simplify(m.brdf, {})[0].modules.keys() == m.brdf.modules.keys()  # nothing is known: nothing is left out


def test_a_network_of_a_zero_operand_stays(llvm):
    """[*] makes something of 0, too."""
    m = Material(enhance("ggx", ("S*D",), seed=1), {"rho_s": 0.0, "rho_d": 0.0})
    assert str(simplify(m.brdf, m.params)[0]) == "S [*] D * F * G * 1/E"


def test_edits_bring_back_what_was_left_out_and_leave_it_out_again(llvm):
    b = material(rho_s2=0, **FRAME).bsdf()
    p = mi.traverse(b)
    wi, wo = directions(N), directions(N, seed=1)
    few = operations(b)
    for values in ({"rho_s2": 0.3}, {"t_theta": 0.7}, {"rho_s2": 0.0, "t_theta": 0.0}, {"rho_d": 0.0}):
        for name, value in values.items():
            p[name] = type(p[name])(value)
        p.update()
        now = {name: np.ravel(p[name].numpy()) for name in p.keys()}
        m = material(**now)
        close(evaluate(b, wi, wo), m.evaluate(wi, wo) * wo[:, 2:])
        assert (operations(b) > few) == bool(now["rho_s2"].any() or now["t_theta"].any())


@pytest.mark.parametrize("update", [False, True])
@pytest.mark.parametrize("name", ["rho_d", "rho_s2"])
def test_what_is_optimized_is_there(llvm, name, update):
    """f is linear in a colour: its derivative at 0 is f at 1 less f at 0."""
    start = {"rho_d": 0.0, "rho_s2": 0.0}
    b, wi, wo = material(**start).bsdf(), directions(N), directions(N, seed=1)
    p = mi.traverse(b)
    dr.enable_grad(p[name])
    if update:
        p[name] = p[name]
        p.update()
    value = b.eval(mi.BSDFContext(), hit(wi), vectors(wo))
    dr.backward(dr.mean(value.y))
    f = [material(**{**start, name: v}).evaluate(wi, wo)[:, 1] * wo[:, 2] for v in (0.0, 1.0)]
    np.testing.assert_allclose(dr.grad(p[name]).y.numpy(), np.mean(f[1] - f[0]), rtol=1e-4)
    assert not dr.grad(p[name]).x.numpy().any()


def test_frame_that_is_optimized_has_gradients(llvm):
    b = material(**FRAME).bsdf()
    p = mi.traverse(b)
    dr.enable_grad(p["t_theta"])
    dr.backward(dr.mean(b.eval(mi.BSDFContext(), hit(directions(N)), vectors(directions(N, seed=1))).x))
    assert abs(dr.grad(p["t_theta"]).numpy()[0]) > 1e-6


def test_frozen_function_follows_a_colour_that_was_0(llvm, no_collection):
    b, wi, wo = material(rho_s2=0).bsdf(), directions(N), directions(N, seed=1)
    p = mi.traverse(b)
    frozen = dr.freeze(lambda b, si, wo: b.eval(mi.BSDFContext(), si, wo))
    for value in (0.0, 0.3, 0.6, 0.0):
        p["rho_s2"] = mi.Color3f(value)
        p.update()
        f = np.array(frozen(b, hit(wi), vectors(wo))).T
        close(f, material(rho_s2=value).evaluate(wi, wo) * wo[:, 2:])


def test_value_and_density_share_their_work(llvm):
    b = material().bsdf()
    both, value, density = (operations(b, name) for name in ("eval_pdf", "eval", "pdf"))
    # Frame, half vector and D are the value's.
    assert both - value < density / 2.5


def test_textured_colour_leaves_the_networks_folded(llvm):
    """No network of ggx2 sees a colour."""

    def count(method, **textures):
        return operations(mi.load_dict({**material().to_dict(), **textures}), method)

    rho_d, f0 = bitmap(np.full((2, 2, 3), 0.3)), bitmap(np.full((2, 2, 1), 0.3))
    feature = 3 * (8 + 9)  # what one of a network's inputs costs, see below
    assert count("eval", rho_d=rho_d) < count("eval", F0=f0) - feature
    assert count("pdf", rho_d=rho_d) > count("pdf", F0=f0)  # F0 says nothing about the density: not fetched


def test_materials_of_one_network_share_a_kernel(llvm):
    """Twenty more with other values compile nothing new, those without a second lobe once."""
    image = lambda m: np.array(mi.render(ball(m.to_dict()), spp=1))  # noqa: E731
    gc.collect()  # BSDFs of earlier tests are part of a kernel until they are collected
    image(material())
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        for k in range(4):
            image(material(rho_d=0.1 + k / 5, alpha_x=0.2 + k / 10, latent=k / 4))
        # Kernels of one lane hold the values in range: small ones, whose shape changes where two values are equal.
        kernels = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT and k["size"] > 1]
        assert len(kernels) >= 4 and all(k["cache_hit"] for k in kernels)


@pytest.mark.parametrize("kind", (baked.Baked, cooperative.Cooperative, baked.Stored, Trainable))
def test_folding_in_two_parts(llvm, kind):
    """What is known first, then the rest; float32 sums in another order."""
    b = networks()
    values = material().as_drjit()
    evaluators = Trainable(b.modules) if kind is Trainable else b.evaluators(kind)
    whole = b.fold(values, evaluators)
    late = {"alpha_x": values["alpha_x"], "F0": values["F0"]}
    unknown = {p.name: [None] * p.size if p.is_colour or p.name == "latent" else None for p in b.parameters}
    begun = b.begin_fold({**values, **dict.fromkeys(late)}, evaluators)
    parts = b.fold({**unknown, **late}, evaluators, begun)
    for slot in b.modules:
        np.testing.assert_allclose(np.ravel(parts[slot]), np.ravel(whole[slot]), rtol=1e-5, atol=1e-6)
        assert not np.allclose(np.ravel(begun[slot]), np.ravel(whole[slot]))


def test_only_what_is_textured_is_folded_at_a_hit(llvm):
    """A feature takes 3 networks of 8 first biases and 9 numbers of the last layer; a literal and an operation each."""
    alpha, f0 = (bitmap(np.full((2, 2, 1), SHAPE[name])) for name in ("alpha_x", "F0"))
    wi, wo = directions(N), directions(N, seed=1)
    counts = []
    for textures in ({}, {"alpha_x": alpha}, {"alpha_x": alpha, "F0": f0}):
        b = mi.load_dict({**material().to_dict(), **textures})
        close(evaluate(b, wi, wo), material().evaluate(wi, wo) * wo[:, 2:])
        counts.append(operations(b))
    plain, with_one, with_two = counts
    feature = 3 * (8 + 9)
    # Beside the texture itself; all nine features, five of shape and four latent, would be 9 * 2 * feature.
    assert with_two - with_one < 4 * feature and with_one - plain < 6 * feature
