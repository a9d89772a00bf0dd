"""The bar follows whatever a long function tells, and is silent on request."""

from __future__ import annotations

import pytest

from mi_enhance.cli.progress_bar import progress_bar
from mi_enhance.system.progress import Progress


def test_bar_shows_stage_steps_and_figures(capsys):
    with progress_bar("fit gold") as tell:
        tell(Progress("starts", 1, 8))
        tell(Progress("starts", 8, 8, {"loss": 0.25}))
        tell(Progress("all", 1, None, {"loss": 0.125}))
    drawn = capsys.readouterr().err.split("\r")
    assert any("fit gold" in line for line in drawn)
    assert drawn[-1].strip() == ""  # it takes itself away


def test_quiet_bar_draws_nothing(capsys):
    with progress_bar("fit", quiet=True) as tell:
        tell(Progress("starts", 1, 8))
    assert capsys.readouterr() == ("", "")


def test_bar_ends_with_the_error_of_the_work(capsys):
    with pytest.raises(ValueError, match="no"), progress_bar("fit"):
        raise ValueError("no")
