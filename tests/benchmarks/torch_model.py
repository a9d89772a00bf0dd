"""The enhanced GGX of the paper in PyTorch: graph, features, sizes and loss are mi_enhance's; for comparison only.

Weights and parameters are leaves; a batch is (M materials, n samples). PyTorch is no dependency of mi_enhance: where it
is missing, `import_torch` says how to get it.
"""

from __future__ import annotations

import sys

import numpy as np

from mi_enhance.neural.enhanced_brdf import EnhancedBRDF
from mi_enhance.neural.mlp import MLP, SLOPE, flatten

_UP = (0.0, 0.0, 1.0)


def import_torch(folder: str | None):
    """PyTorch, from `folder` if given (made by ``pip install --target``)."""
    if folder:
        sys.path.append(folder)  # last: it brings its own NumPy, which must not replace ours
    try:
        import torch
    except ImportError as error:
        raise SystemExit(
            f"training_throughput.py: PyTorch cannot be imported ({error}). Install it outside of the project, "
            "pip install --target /tmp/torch torch   and add   --torch /tmp/torch"
        ) from error
    return torch


class TorchModel:
    """Loss and gradients of eq. 1 by automatic differentiation.

    Parameters
    ----------
    torch : module
    brdf : EnhancedBRDF
        GGX with networks in the slots F, F*G, G and 1/E, and symmetric inputs.
    start : array (M, 39)
        Parameters in the space that is optimized (log alpha).
    wi, wo, f : array (M, n, 3)
    folded : bool
        Whether the inputs that are constant for a material enter the first layer once per material, as in mi_enhance,
        or with every sample, as the paper's figure shows it.
    """

    def __init__(self, torch, brdf: EnhancedBRDF, start, wi, wo, f, folded: bool):
        assert set(brdf.modules) == {"F", "F*G", "G", "1/E"} and brdf.inputs == "symmetric"
        self.torch, self.folded = torch, folded
        self.wi, self.wo, self.f = (torch.from_numpy(np.ascontiguousarray(v, np.float32)) for v in (wi, wo, f))
        self.weights = {}
        for slot, mlp in brdf.modules.items():
            (w, b), *rest = mlp.layers
            k = mlp.n_folded if folded else 0
            parts = [w[:, :k], w[:, k:], b, *(v for layer in rest for v in layer)]
            self.weights[slot] = [torch.tensor(v, requires_grad=True) for v in parts]
        self.parameters = torch.tensor(np.asarray(start, np.float32), requires_grad=True)
        self.leaves = [self.parameters, *(v for parts in self.weights.values() for v in parts if v.numel())]
        self.step = self._step

    def compile(self) -> None:
        """Let TorchInductor fuse what it can."""
        compiled = self.torch.compile(self._loss)
        self.step = lambda: self._step(compiled)

    def _step(self, loss_of=None):
        loss = (loss_of or self._loss)()
        return loss.detach(), self.torch.autograd.grad(loss.mean(), self.leaves)

    def flat_gradients(self, gradients, networks: dict) -> tuple[np.ndarray, np.ndarray]:
        """Gradients of weights and parameters, ordered as mi_enhance stores them."""
        parameters, *rest = gradients
        rest, layers = iter(rest), {}
        for slot, parts in self.weights.items():
            g = [next(rest).numpy() if v.numel() else v.detach().numpy() for v in parts]
            pairs = [(np.concatenate(g[:2], 1), g[2]), *zip(g[3::2], g[4::2], strict=True)]
            layers[slot] = MLP(tuple(pairs), networks[slot].n_folded)
        return flatten(layers), parameters.numpy().T.ravel()

    def _network(self, slot, constant, x):
        linear, relu = self.torch.nn.functional.linear, self.torch.nn.functional.leaky_relu
        w_constant, w, b, *rest = self.weights[slot]
        if constant is None:
            z = linear(x, w, b)
        elif self.folded:
            z = linear(x, w) + linear(constant, w_constant, b)[:, None]
        else:
            z = linear(self.torch.cat([constant[:, None].expand(-1, x.shape[1], -1), x], -1), w, b)
        for w, b in zip(rest[::2], rest[1::2], strict=True):
            z = linear(relu(z, SLOPE), w, b)
        return self.torch.exp(self.torch.clamp(z[..., 0], -30, 30))

    def _loss(self):
        """Per material, (M,)."""
        torch = self.torch
        u = self.parameters
        n_x, n_y, t_theta = u[:, 0:1], u[:, 1:2], u[:, 2]
        rho_d, rho_s, alpha, f0, latent = u[:, 3:6], u[:, 6:9], torch.exp(u[:, 9:11]), u[:, 11:12], u[:, 12:]
        a_x, a_y = alpha[:, 0:1], alpha[:, 1:2]
        n = torch.cat([n_x, n_y, torch.sqrt(torch.clamp(1 - n_x * n_x - n_y * n_y, min=0))], -1)
        t = torch.nn.functional.normalize(torch.tensor([1.0, 0.0, 0.0]) - n * n_x, dim=-1)
        b = torch.linalg.cross(n, t)
        s, c = torch.sin(t_theta)[:, None], torch.cos(t_theta)[:, None]
        frame = torch.stack([c * t + s * b, c * b - s * t, n], -1)  # columns: to local by one product
        i, o = self.wi @ frame, self.wo @ frame
        active = (self.wi[..., 2] > 0) & (self.wo[..., 2] > 0) & (i[..., 2] > 0) & (o[..., 2] > 0)
        up = torch.tensor(_UP)
        i, o = torch.where(active[..., None], i, up), torch.where(active[..., None], o, up)
        s = i + o
        square = torch.clamp((s * s).sum(-1), min=1e-12)
        h = s * torch.rsqrt(square)[..., None]
        cos_d = torch.clamp(0.5 * torch.sqrt(square), max=1)
        x2, y2 = torch.square(h[..., 0]), torch.square(h[..., 1])
        p, q = x2 / torch.square(a_x), y2 / torch.square(a_y)
        cosines = i[..., 2] * o[..., 2]
        directions = torch.stack(
            [
                x2 + y2,
                torch.log(1 + p + q) / 5,
                (p - q) / (1 + p + q) * ((a_y - a_x) / (a_x + a_y)),
                cos_d,
                cosines,
                torch.log(cosines + 1e-4) / 5,
            ],
            -1,
        )
        scaled = [torch.log(alpha) / 4, torch.sqrt(f0 + 1e-4), rho_d, torch.log(1 + rho_s), alpha, f0, latent]
        constant = torch.cat(scaled, -1)
        d = 1 / (torch.pi * a_x * a_y * torch.square(p + q + torch.square(h[..., 2])))
        fresnel = self._network("F", constant, directions)
        masking = self._network("G", constant, directions) * self._network("1/E", constant, directions)
        operands = torch.log(torch.clamp(torch.stack([fresnel, masking], -1), min=1e-6))
        lobe = d * self._network("F*G", None, operands)
        value = rho_d[:, None] / torch.pi + rho_s[:, None] * lobe[..., None]
        value = torch.where(active[..., None], value, 0) * self.wo[..., 2:]
        truth = torch.log(1 + self.f * self.wo[..., 2:])
        return torch.abs(truth - torch.log(1 + value)).mean((1, 2))
