"""The machine: LLVM, variants, files that are written whole or not at all, what comes with the package."""
