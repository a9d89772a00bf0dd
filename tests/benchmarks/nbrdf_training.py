"""NBRDF as :func:`mi_enhance.benchmark.nbrdf.train_nbrdf` trains it against the authors' networks.

On stand-ins for MERL materials, both judged by the same unseen samples.
"""

from __future__ import annotations

import common

from mi_enhance import data
from mi_enhance.benchmark.nbrdf import train_nbrdf
from mi_enhance.data import nbrdf
from mi_enhance.fitting.losses import log_l1

_COLUMNS = {
    "material": ("material", ""),
    "authors": ("log-L1, authors", ".5f"),
    "ours": ("ours", ".5f"),
    "ratio": ("ratio", ".3f"),
    "seconds": ("s", ".1f"),
}


def main() -> None:
    """Run the check of the command line."""
    from common import finish

    from mi_enhance.benchmark.timing import machine

    parser = common.parser(__doc__)
    parser.add_argument("materials", nargs="*", default=["gold-metallic-paint", "blue-acrylic", "red-phenolic"])
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--epochs", type=int, default=400)
    parser.add_argument("--learning-rate", type=float, default=1e-2)
    args = parser.parse_args()
    about = machine()
    names, networks = nbrdf.read_networks(common.BUNDLED / "nbrdf/merl.npz")
    rows = []
    for name in args.materials:
        seen, unseen = (
            data.load(common.BUNDLED / "nps/merl.npz", material=name, n_samples=n, seed=seed)
            for n, seed in ((args.samples, 0), (20_000, 1))
        )
        network, seconds = train_nbrdf(seen, epochs=args.epochs, learning_rate=args.learning_rate)
        authors = {key: w[names.index(name)] for key, w in networks.items()}
        losses = [log_l1(nbrdf.decode(w, unseen.wi, unseen.wo), unseen.f, unseen.wo[:, 2]) for w in (authors, network)]
        rows.append({"material": name, "authors": losses[0], "ours": losses[1], "seconds": seconds})
        rows[-1]["ratio"] = losses[1] / losses[0]
    finish(rows, _COLUMNS, title=f"{args.samples:,} samples, {args.epochs} epochs", about=about, as_json=args.json)


if __name__ == "__main__":
    main()
