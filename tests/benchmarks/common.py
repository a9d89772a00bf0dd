"""What the benchmarks share: names of folders, what is shipped, the end of a run."""

from __future__ import annotations

import json


def folder_name(label: str) -> str:
    """The label of a run as the name of its folder."""
    return "".join(c if c.isalnum() else "_" for c in label)


def shipped() -> dict:
    """Materials with the parameters that every analytic model and network of the package starts from."""
    from mi_enhance import Material, models
    from mi_enhance._files import network_file

    result = {name: Material.analytic(name) for name in sorted(models.MODELS)}
    networks = sorted(network_file("ggx").parent.glob("*.bsdf"))
    return result | {f"network {path.stem}": Material.load(path) for path in networks}


def finish(rows: list[dict], columns: dict, *, title: str, about: dict, as_json: bool) -> None:
    """Print the table and the machine; one JSON object last if asked for."""
    from mi_enhance.table import print_table

    print_table(rows, columns, title=title)
    print(", ".join(f"{key} {value}" for key, value in about.items()))
    if as_json:
        print(json.dumps({"machine": about, "rows": rows}))
