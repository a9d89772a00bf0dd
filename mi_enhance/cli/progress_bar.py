"""The one progress bar of the command line."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from ..system.progress import Callback, Progress, silent


@contextlib.contextmanager
def progress_bar(title: str, *, quiet: bool = False) -> Iterator[Callback]:
    """Draw a bar on stderr while the block runs, and yield what a long function calls to move it.

    Parameters
    ----------
    title : str
    quiet : bool
        Draw nothing.

    Examples
    --------
    >>> with progress_bar("fit", quiet=True) as tell:
    ...     tell(Progress("enhanced", 1, 10, {"loss": 0.5}))
    """
    if quiet:
        yield silent
        return
    from tqdm import tqdm

    with tqdm(desc=title, unit=" steps", leave=False) as bar:
        stage = ""

        def tell(progress: Progress) -> None:
            nonlocal stage
            if progress.stage != stage:
                stage = progress.stage
                bar.reset(progress.total)
            bar.total = progress.total
            figures = (f"{name} {value:.5g}" for name, value in progress.values.items())
            bar.set_postfix_str(", ".join([stage, *figures]), refresh=False)
            bar.update(progress.step - bar.n)

        yield tell
