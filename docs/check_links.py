"""Every link of the site, by Sphinx's `linkcheck`: what is wrong fails, what could not be looked at is listed.

    python docs/check_links.py out/docs-links

Links within the site, anchors included, are looked at without a network. Of the others a page that says "not found"
is an error. A host that does not answer, as all do without a network, is none: it is listed as unreachable.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path


def verdicts(entries: Iterable[dict]) -> dict[str, list[str]]:
    """Return lines on links under ``ok``, ``unreachable`` and ``wrong``; an entry is a line of linkcheck's output.

    Examples
    --------
    >>> entry = {"filename": "faq.md", "lineno": 3, "uri": "https://x.org", "status": "broken"}
    >>> entry |= {"code": 404, "info": "404"}
    >>> verdicts([entry])["wrong"]
    ['faq.md:3: https://x.org (404)']
    >>> verdicts([{**entry, "code": 0, "info": "Failed to resolve"}])["unreachable"]
    ['faq.md:3: https://x.org (Failed to resolve)']
    """
    found: dict[str, list[str]] = {"ok": [], "unreachable": [], "wrong": []}
    for entry in entries:
        info = " ".join(str(entry.get("info", "")).split())[:80]
        line = f"{entry['filename']}:{entry['lineno']}: {entry['uri']} ({info})"
        outside = entry["uri"].startswith(("http://", "https://"))
        # 0: nobody answered; 403, 429 and 5xx: somebody who does not want to, or cannot now
        silent = entry.get("code", 0) in (0, 403, 407, 429) or entry.get("code", 0) >= 500
        if entry["status"] in ("broken", "timeout"):
            found["unreachable" if outside and silent else "wrong"].append(line)
        else:
            found["unreachable" if entry["status"] in ("ignored", "rate-limited") else "ok"].append(line)
    return found


def main(folder: str) -> int:
    """Run the check into `folder` and return the exit status."""
    docs = Path(__file__).parent
    # a warning is an error: a link within the site that leads nowhere is one
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "linkcheck", str(docs), folder]
    output = Path(folder) / "output.json"
    output.unlink(missing_ok=True)
    child = subprocess.run(command, capture_output=True, text=True)
    internal = [line for line in child.stderr.splitlines() if "WARNING" in line and "broken link" not in line]
    if not output.exists():
        print(child.stdout, child.stderr, sep="\n", file=sys.stderr)
        return 2
    found = verdicts(json.loads(line) for line in output.read_text().splitlines())
    for kind in ("unreachable", "wrong"):
        print("\n".join(f"{kind}: {line}" for line in found[kind]))
    print("\n".join(internal))
    numbers = ", ".join(f"{len(lines)} {kind}" for kind, lines in found.items())
    print(f"links: {numbers}; warnings of the pages: {len(internal)}")
    return 1 if found["wrong"] or internal else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
