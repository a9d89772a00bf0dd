"""Who does the work of a command that several may do: this process, processes of this machine, or a Dask cluster."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor

from . import arguments


def add_workers(parser: argparse.ArgumentParser, does: str) -> None:
    """Add the options; `does` says what a worker does."""
    parser.add_argument(
        "--workers",
        type=arguments.positive,
        default=1,
        metavar="N",
        help=f"processes on this machine, each of which {does} (default: 1)",
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help=f"Dask scheduler, each of whose workers {does}; they must see the files"
    )


def check(args: argparse.Namespace) -> None:
    """Raise ValueError if both options are given."""
    if args.scheduler and args.workers > 1:
        raise ValueError("--workers and --scheduler exclude each other: a Dask cluster has its own workers.")


@contextlib.contextmanager
def executor(args: argparse.Namespace) -> Iterator[Executor | None]:
    """Yield who does the work, None for this process, from the options of :func:`add_workers`.

    Raises
    ------
    ImportError
        If `distributed` is not installed and a scheduler was asked for.
    OSError
        If no scheduler answers.
    RuntimeError
        If a process of this machine died. What it had finished is kept.
    """
    if args.scheduler:
        with _cluster(args.scheduler) as pool:
            yield pool
    elif args.workers > 1:
        with _processes(args.workers) as pool:
            yield pool
    else:
        yield None


@contextlib.contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError:
        raise ImportError('--scheduler needs Dask. Install it: pip install "mi-enhance[cluster]"') from None
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        raise OSError(
            f'--scheduler: no Dask scheduler answers at "{address}" ({error}). Start one with `dask scheduler`, and '
            "give the address that it prints."
        ) from None
    with client:
        # a killed worker's work is done by another; pure=False: Dask does not take a result from before
        yield client.get_executor(pure=False)


@contextlib.contextmanager
def _processes(n: int) -> Iterator[Executor]:
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    # spawn: Dr.Jit's threads do not survive a fork
    pool = ProcessPoolExecutor(n, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    except BrokenProcessPool:
        raise RuntimeError(
            "--workers: one of the processes died, perhaps for want of memory. Run the command again, with fewer of "
            "them if need be: what they had finished is kept."
        ) from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
