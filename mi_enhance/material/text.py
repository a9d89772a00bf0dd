"""A material as a text: what `Material.show` says."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .material import Material


def text_of(material: Material) -> str:
    """Return equation, parameters and report."""
    brdf = material.brdf
    lines = [str(brdf)]
    for p in brdf.parameters:
        values = material.params[p.name]
        many = p.name in ("read_out", "code")
        text = f"{len(values)} numbers" if many else " ".join(f"{v:.4g}" for v in values)
        lines.append(f"  {p.name:<8} {text}")
    trunk = brdf.trunk
    if trunk:
        kind = "RGB factors" if trunk.channels == 3 else "factors"
        sizes = "-".join(map(str, trunk.mlp.sizes))
        own = f"codes of {trunk.rank} numbers times a shared basis" if trunk.basis else "numbers of its own"
        lines.append(f"  {', '.join(trunk.slots)}: {kind}, read out of one trunk {sizes} by {own}")
    for c in brdf.distilled:
        kind = "RGB factors from a network of its own" if c.channels == 3 else "from a network"
        lines.append(f"  {', '.join(c.slots)}: {kind} {'-'.join(map(str, c.sizes))} of {', '.join(c.inputs)}")
    lines.append(
        f"  {brdf.n_parameters} parameters ({material.n_bytes} bytes), {brdf.n_weights} shared weights, "
        f"inputs: {brdf.inputs}"
    )
    if material.bound_energy:
        lines.append("  energy: directional albedo at most 1")
    undetermined = material.report.get("undetermined")
    if undetermined and isinstance(undetermined, list):
        lines.append(f"  not determined by the samples: {', '.join(_by_name(undetermined))}")
    if material.report.get("edited"):
        lines.append(f"  edited since the fit, whose errors these are: {', '.join(material.report['edited'])}")
    for key, value in material.report.items():
        if isinstance(value, (int, float, str)):
            lines.append(f"  {key}: {value:.6g}" if isinstance(value, float) else f"  {key}: {value}")
    return "\n".join(lines)


def _by_name(components: list[str]) -> list[str]:
    """Names of parameters, with the number of their components where there are several.

    Examples
    --------
    >>> _by_name(["F0", "latent.03", "latent.07"])
    ['F0', 'latent (2)']
    """
    counts = Counter(str(name).partition(".")[0] for name in components)
    return [name if n == 1 else f"{name} ({n})" for name, n in counts.items()]
