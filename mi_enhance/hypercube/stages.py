"""The stages of a search: their log, the state that a stage begins with, and the candidates around it."""

from __future__ import annotations

import json
from pathlib import Path

from ..system.files import read_json, write_text
from . import states
from .setup import Setup


def read_stages(folder: Path) -> list[dict]:
    """Return the finished stages of the search in `folder`; :class:`.search.SearchResult` says what they hold."""
    log = folder / "stages.jsonl"
    return read_json(log, "search()", ("stage", "current", "best", "candidates"), lines=True) if log.exists() else []


def write_stages(folder: Path, stages: list[dict]) -> None:
    """Write the log as a whole: a killed search never leaves half a line."""
    write_text(folder / "stages.jsonl", "".join(json.dumps(s) + "\n" for s in stages))


def is_over(stages: list[dict]) -> bool:
    """Return whether the last stage left its state unchanged, which ends a search."""
    return bool(stages) and stages[-1]["best"] == stages[-1]["current"]


def current_of(setup: Setup, stages: list[dict]) -> states.State:
    """Return the state that the stage after `stages` begins with."""
    return tuple(stages[-1]["best"]) if stages else (0,) * len(setup.choices)


def candidates_of(setup: Setup, stages: list[dict]) -> list[states.State]:
    """Return the candidates of the stage after `stages`, the unchanged state first."""
    current = current_of(setup, stages)
    left = {tuple(s["current"]) for s in stages} - {current}  # a state that has lost does not come back
    around = states.neighbours(
        current, setup.choices, distance=setup.settings.distance, max_modules=setup.settings.max_modules
    )
    return [digits for digits in around if digits not in left]
