"""Tables of text with something changed in their structure: header, cells, separators, units, lines, encoding.

``python table_mutations.py [N]`` reads N of them and says how many were read, refused, or ended otherwise, and the peak
of memory.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import tracemalloc
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from mi_enhance import data

_HEADERS = (
    "wi_x wi_y wi_z wo_x wo_y wo_z f_r f_g f_b",
    "theta_i phi_i theta_o phi_o f",
    "theta_i_deg phi_i_deg theta_o_deg phi_o_deg f_r f_g f_b note",
    "f theta_i phi_i theta_o phi_o time",
)
_SEPARATORS = (",", ";", "\t", " ", ", ", "|")
_CELLS = (
    "", " ", "nan", "-inf", "1e999", "-1", "0", "90", "1e-320", "1,5", "1.234,5", "1 000", "0x10", "1_0", "١", "½",
    "-", "NaN", "#", '"', "'", '"0.1"', '""', "True", "1e", "--1", "+.5", "9" * 400, "\0", "\ufeff", "é", "=1+1",
    "12:30",
)  # fmt: skip
_LINES = (
    "", "#", "# angles in degrees", "% 23 °C", "//", "sep=;", '"', '""""', ",,,,,", ";;;;", "\t\t\t", "{", "<html>",
    "rad,rad,rad,rad,1/sr", "deg;deg;deg;deg;", "\x1a", "theta_i", "f,f,f,f,f", "0,0,0,0,0", "1 2 3 4 5 6 7 8 9",
    "(" * 300,
)  # fmt: skip
_NAMES = (
    "theta_i",
    "f",
    "f_r",
    "wi_x",
    "theta_i [deg]",
    "theta_i [mm]",
    "f (1/sr)",
    "phi_o/rad",
    "F",
    "[",
    "",
    "x" * 200,
)


def mutated(rng: np.random.Generator) -> bytes:
    """Return a table with none to four changes."""
    names = str(rng.choice(_HEADERS)).split()
    rows = [[f"{v:.6g}" for v in _row(names, rng)] for _ in range(max(1, rng.integers(-1, 6)))]
    cells = [names, *rows]
    for _ in range(max(0, rng.integers(-2, 4))):
        _change(cells, rng)
    separators = [str(rng.choice(_SEPARATORS))] * 2
    if rng.random() < 0.2:  # the header has another one than the numbers
        separators[0] = str(rng.choice(_SEPARATORS))
    lines = [separators[min(k, 1)].join(line) for k, line in enumerate(cells)]
    if rng.random() < 0.2 and separators[1] != ",":
        lines[1:] = [line.replace(".", ",") for line in lines[1:]]
    if rng.random() < 0.3:
        lines[0] = str(rng.choice(("# ", "#", "%", "// ", '"', "##"))) + lines[0]
    for _ in range(max(0, rng.integers(-2, 3))):
        lines.insert(int(rng.integers(0, len(lines) + 1)), str(rng.choice(_LINES)))
    text = str(rng.choice(("\n", "\r\n", "\r", "\n\n"))).join(lines) + str(rng.choice(("\n", "")))
    encoding = str(rng.choice(("utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1", "cp1252")))
    content = text.encode(encoding, errors="replace")
    return content[: rng.integers(len(content) + 1)] if rng.random() < 0.1 else content


def _row(names: list[str], rng: np.random.Generator) -> list[float]:
    """Return values that fit the names, or nearly: a normal and a light at 60 degrees."""
    degrees = "theta_i_deg" in names
    angles = [rng.uniform(0, 85 if degrees else 1.5), rng.uniform(-180, 360) if degrees else rng.uniform(-3, 6)]
    known = {"wi_z": 1.0, "wo_x": 0.8, "wo_z": 0.6, "f": 0.3, "f_r": 0.3, "note": 7.0, "time": 1.0}
    return [known.get(n, angles[n.startswith("phi")] if n.startswith(("theta", "phi")) else 0.0) for n in names]


def _change(cells: list[list[str]], rng: np.random.Generator) -> None:
    line = cells[rng.integers(len(cells))] if rng.random() < 0.7 else cells[0]
    k = int(rng.integers(len(line) + 1))
    new = str(rng.choice(_NAMES if line is cells[0] else _CELLS))
    kind = rng.integers(5)
    if kind == 0:
        line.insert(k, new)
    elif kind == 1 and line:
        line[k % len(line)] = new
    elif kind == 2 and line:
        del line[k % len(line)]
    elif kind == 3 and line:
        line[k % len(line)] += new
    elif kind == 4:
        for some in cells:  # a column of its own
            some.insert(min(k, len(some)), str(rng.choice(_CELLS)))


def outcome(path: Path) -> str:
    """Return "read" or "refused"; any other error, or a message that does not name the file, is raised."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", "data.load", UserWarning)  # many rows below the horizon
            m = data.load(path, kind="table")
    except ValueError as error:
        message = str(error)
        assert message.startswith(f'data.load("{path}"): '), message
        assert len(message) < 1000 and message.isprintable(), message
        return "refused"
    assert np.isfinite(m.f).all() and (m.f >= 0).all() and (m.wi[:, 2] > 0).all() and (m.wo[:, 2] > 0).all()
    return "read"


if __name__ == "__main__":
    path, count = Path(tempfile.mkdtemp()) / "t.csv", Counter()
    tracemalloc.start()
    for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000):
        path.write_bytes(mutated(np.random.default_rng(seed)))
        try:
            count[outcome(path)] += 1
        except Exception as error:
            count["otherwise"] += 1
            print(seed, type(error).__name__, error)
    print(dict(count), f"peak of Python {tracemalloc.get_traced_memory()[1] / 1e6:.1f} MB,")
    print(f"of the process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB")
