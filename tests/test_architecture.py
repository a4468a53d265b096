"""Imports run one way: each module may use only those that stand before it on the way from files to positions."""

from __future__ import annotations

import ast
from pathlib import Path

import oneform_warp

ROOT = Path(oneform_warp.__file__).parent

# The picture of ARCHITECTURE.md as layers: a module imports from layers above its own only (solvers and cli are folders).
LAYERS = [
    ["errors"],
    ["replay", "sorting", "rotations", "procrustes", "segments", "profiles", "surface", "intersections", "rigidity"],
    ["arrays", "polygons", "conditions", "handle_values"],
    ["weld", "incidence", "weights", "shapes", "strain", "principal"],
    ["order", "intake", "handles", "measures"],
    ["assembly", "struts", "symmetry", "constraints"],
    ["graph", "constraint_kinds"],
    ["forms", "tree", "centroids", "cells", "cycles", "patches", "heat", "joints", "stretches"],
    ["exactness", "rings", "solvers", "smoothness", "presets", "arms"],
    ["grip", "rest", "starts"],
    ["influence", "overlap", "geodesics", "biharmonic", "places", "equations", "arap_energy"],
    ["falloff", "arap"],
    ["fields"],
    ["notes", "between", "refiner"],
    ["deformation"],
    ["deformer"],
    ["deformers", "sequences"],
    ["preview_polyscope"],
    ["panels"],
    ["preview", "movie", "filters"],
    ["cli"],
]
LAYER = {name: number for number, names in enumerate(LAYERS) for name in names}
# Side by side in one layer, and still one way.
WITHIN = {("exactness", "tree"), ("preview_polyscope", "preview")}


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("oneform_warp."):
            names.add(node.module.split(".")[1])
        elif isinstance(node, ast.ImportFrom) and node.module == "oneform_warp":
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith("oneform_warp.")}
    return names


def modules() -> list[tuple[str, Path]]:
    files = [path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py"]
    # A linked folder is not walked into.
    linked = [("filters", path) for path in (ROOT / "filters").rglob("*.py")]
    return [(path.relative_to(ROOT).parts[0].removesuffix(".py"), path) for path in files] + linked


def test_every_module_has_a_place() -> None:
    assert {name for name, _ in modules()} == set(LAYER)


def test_imports_run_one_way() -> None:
    wrong = [
        f"{path.relative_to(ROOT)} imports {other}"
        for name, path in modules()
        for other in imported(path)
        if other in LAYER and other != name and LAYER[other] >= LAYER[name] and (name, other) not in WITHIN
    ]
    assert wrong == []


def test_solvers_import_one_way() -> None:
    order = [
        "precision", "solution", "validation", "loop", "anchors", "goals", "system", "rows", "refinement", "jacobi", "cg", "multigrid", "direct",
        "solver", "states", "constrained", "choice", "least_squares", "__init__",
    ]  # fmt: skip
    place = {name: number for number, name in enumerate(order)}
    for path in (ROOT / "solvers").rglob("*.py"):
        name = path.relative_to(ROOT / "solvers").parts[0].removesuffix(".py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("oneform_warp.solvers."):
                other = str(node.module).split(".")[2]
                assert place[other] < place[name] or (
                    other == name and name in ("multigrid", "direct", "constrained")
                ), f"{path.name} imports {other}"


def test_the_core_imports_no_file_format_and_no_plotting() -> None:
    heavy = {"pymeshlab", "trimesh", "matplotlib", "polyscope"}
    for name, path in modules():
        if LAYER[name] >= LAYER["preview_polyscope"]:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            found = {a.name.split(".")[0] for a in node.names} if isinstance(node, ast.Import) else set()
            found |= {(node.module or "").split(".")[0]} if isinstance(node, ast.ImportFrom) else set()
            assert not found & heavy, f"{path.name} imports {found & heavy}"
