"""The command line: finds the command, and turns what goes wrong into one line.

What a command takes and does is in the file of its name; nothing heavy is imported before one is chosen. Scripts depend
on the names and options of the commands, and on the JSON that ``--json`` prints last on stdout.
"""

from __future__ import annotations

import argparse
import json
import sys

from .. import __version__
from ..system import llvm
from . import (
    bench,
    check,
    compare,
    convert,
    demo,
    doctor,
    export,
    figure,
    fit,
    fit_images,
    plot,
    render,
    search,
    show,
    specialize,
    streams,
    train,
    view,
)
from .arguments import OUTPUT_RULE

_COMMANDS = (
    doctor,
    demo,
    fit,
    fit_images,
    render,
    show,
    plot,
    check,
    specialize,
    export,
    view,
    convert,
    train,
    search,
    compare,
    bench,
    figure,
)
_OUR_ERRORS = (ValueError, KeyError, RuntimeError, OSError, ImportError)  # what a wrong input or machine can raise


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    argv : list of str, optional
        The arguments; those of the process if left out.

    Returns
    -------
    int
        Exit status: 0 done, 1 doctor found that rendering does not work or check that something is off, 2 an error,
        130 interrupted, 141 nobody reads the output any more.

    Examples
    --------
    >>> main(["show", "gold.bsdf"])  # doctest: +SKIP
    0
    """
    streams.accept_any()
    with streams.until_closed():
        return _run(parser().parse_args(argv))


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="mi-enhance", description="Neural enhancement of analytical BRDFs for Mitsuba 3.", epilog=OUTPUT_RULE
    )
    parser.add_argument("--version", action="version", version=f"mi-enhance {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in _COMMANDS:
        module.add(subparsers)
    return parser


def _run(args: argparse.Namespace) -> int:
    try:
        if llvm.problem and args.command != "doctor":
            raise ImportError(llvm.problem)
        result = args.run(args)
        if args.json:
            print(json.dumps(result))
    except KeyboardInterrupt:
        print("mi-enhance: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        raise
    except SystemExit:  # what rich makes of a closed pipe
        return streams.CLOSED
    except Exception as error:
        if args.traceback:
            raise
        print(f"mi-enhance: {_one_line(error)}", file=sys.stderr)
        return 2
    return 0 if result.get("rendering_works", True) and result.get("ok", True) else 1


def _one_line(error: Exception) -> str:
    """Return the sentence of an error: Mitsuba passes on a plugin's error with its whole traceback around it."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    lines = [line.strip() for line in text.splitlines() if line.strip()] or [repr(error)]
    if "Traceback (most recent call last):" in text:
        lines = [lines[-1].partition("Error: ")[2] or lines[-1]]
    line = " ".join(lines).removeprefix("mi_enhance: ")
    if isinstance(error, _OUR_ERRORS) or type(error) is Exception:  # Mitsuba raises the bare class
        return line
    return f"{type(error).__name__}: {line} (--traceback shows where)"
