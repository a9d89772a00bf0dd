"""Variants for the tests: the fixture a test names is the backend it runs on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import mi_enhance  # noqa: F401  (first: it finds the LLVM that Dr.Jit then loads)

import drjit as dr  # isort: skip
import mitsuba as mi  # isort: skip
import pytest
from hypothesis import settings

# The same examples in every run; `--hypothesis-profile=random` looks for new ones.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("random", deadline=None)
settings.load_profile("same")


@pytest.fixture(scope="session", autouse=True)
def root():
    """Run in the root of the repository, wherever pytest was started: tests name files from there."""
    os.chdir(Path(__file__).parents[1])


@pytest.fixture
def llvm():
    """Activate ``llvm_ad_rgb``."""
    mi.set_variant("llvm_ad_rgb")


@pytest.fixture
def cuda():
    """Activate ``cuda_ad_rgb`` where there is a GPU."""
    if not dr.has_backend(dr.JitBackend.CUDA):
        pytest.skip("no NVIDIA GPU with a working driver on this machine")
    mi.set_variant("cuda_ad_rgb")


@pytest.fixture
def no_collection():
    """Keep what earlier tests have left from being freed while Dr.Jit records a frozen function, which would abort."""
    from mi_enhance.system import garbage_collection

    with garbage_collection.no_collection():
        yield


@pytest.fixture
def run_child():
    """Return a function that runs Python code in a fresh process without our LLVM setting."""

    def run(code: str, **environment: str) -> subprocess.CompletedProcess:
        clean = {k: v for k, v in os.environ.items() if k != "DRJIT_LIBLLVM_PATH"}
        return subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env={**clean, **environment}
        )

    return run
