"""Run all examples: `python -m examples [FOLDER]` draws every figure, default figures/, and prints every number."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import warp as wp

HERE = Path(__file__).parent
HELPERS = {"__main__", "meshes", "pictures"}


def main() -> None:
    # The examples are scripts that find their two helpers beside them.
    sys.path.insert(0, str(HERE))
    folder = import_module("pictures").figure_folder()
    wp.config.log_level = wp.LOG_WARNING
    for name in sorted(path.stem for path in HERE.glob("*.py")):
        if name not in HELPERS:
            example = import_module(name)
            print(f"{name}: {example.__doc__.splitlines()[0]}")
            example.main(folder)


if __name__ == "__main__":
    main()
