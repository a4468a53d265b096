"""Compile every kernel for a GPU that need not be here: Warp carries the compiler. Run by `make test`."""

from __future__ import annotations

import importlib
import pkgutil
import sys
import time

import warp as wp

import oneform_warp

ARCHITECTURE = 90


def kernel_modules() -> list[wp.Module]:
    """The Warp modules of this package that hold kernels, once every Python module is imported."""
    for info in pkgutil.walk_packages(oneform_warp.__path__, "oneform_warp."):
        if "filters" not in info.name and "cli" not in info.name and "preview" not in info.name:
            importlib.import_module(info.name)
    registered = importlib.import_module("warp._src.context").user_modules
    return [m for name, m in sorted(registered.items()) if name.startswith("oneform_warp.") and m.kernels]


def main() -> int:
    wp.config.log_level = wp.LOG_WARNING
    wp.init()
    began = time.perf_counter()
    modules = kernel_modules()
    kernels = 0
    for module in modules:
        wp.compile_aot_module(module, arch=ARCHITECTURE)
        kernels += len(module.kernels)
    print(
        f"{kernels} kernels in {len(modules)} modules compile for sm_{ARCHITECTURE}, {time.perf_counter() - began:.0f} s"
    )
    return 0 if kernels else 1


if __name__ == "__main__":
    sys.exit(main())
