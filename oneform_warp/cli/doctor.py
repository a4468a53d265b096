"""`oneform-warp doctor`: what is installed, what is missing, and whether kernels compile."""

import ctypes
import platform
import sys
from importlib.metadata import PackageNotFoundError, version

import click

from oneform_warp import __version__
from oneform_warp.cli.terminal import start_warp

__all__ = ["command", "filter_count", "missing_libraries"]

PACKAGES = {
    "warp": "warp-lang",
    "numpy": "numpy",
    "scipy": "scipy",
    "lark": "lark",
    "pymeshlab": "pymeshlab",
    "trimesh": "trimesh",
    "matplotlib": "matplotlib",
    "polyscope": "polyscope",
    "imageio-ffmpeg": "imageio-ffmpeg",
}
NEEDED = ("warp", "numpy", "scipy", "lark")

DEBIAN = {"libGL.so.1": "libgl1", "libOpenGL.so.0": "libopengl0", "libEGL.so.1": "libegl1"}

FILTERS = 281
"""Filters of a complete PyMeshLab 2025.7."""


@click.command("doctor")
@click.pass_context
def command(ctx: click.Context) -> None:
    """Say what is installed and what is missing.

    The exit code is 1 if meshes cannot be deformed here.
    """
    found = _packages()
    problems = [f"{name} is missing: pip install {PACKAGES[name]}" for name in NEEDED if found[name] is None]
    _libraries()
    problems += _readers(found)
    if not problems:
        problems += _kernels()
    for problem in problems:
        click.echo(f"problem: {problem}")
    click.echo("meshes cannot be deformed here" if problems else "ready: meshes can be deformed here")
    ctx.exit(1 if problems else 0)


def line(label: str, value: str) -> None:
    """One finding."""
    click.echo(f"{label:<14} {value}")


def _packages() -> dict[str, str | None]:
    """Versions by name, None for what is missing."""
    line("oneform_warp", __version__)
    line("Python", f"{platform.python_version()} on {platform.platform()}")
    found: dict[str, str | None] = {}
    for name, package in PACKAGES.items():
        try:
            found[name] = version(package)
        except PackageNotFoundError:
            found[name] = None
        line(name, found[name] or "not installed")
    return found


def missing_libraries() -> list[str]:
    """The system libraries of DEBIAN that cannot be loaded; none where they have other names."""
    if not sys.platform.startswith("linux"):
        return []
    return [name for name in DEBIAN if not _loads(name)]


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _libraries() -> None:
    missing = missing_libraries()
    if not missing:
        line("libraries", "nothing is missing")
        return
    line("libraries", f"{', '.join(missing)} missing; on Debian or Ubuntu:")
    packages = " ".join(DEBIAN[name] for name in missing)
    line("", f"sudo apt-get install --no-install-recommends {packages}")


def filter_count() -> int | None:
    """How many filters PyMeshLab has, None where it does not load."""
    try:
        import pymeshlab
    except (ImportError, OSError):
        return None
    return len(pymeshlab.filter_list())


def _readers(found: dict[str, str | None]) -> list[str]:
    """The state of the mesh readers -> problems: there must be one."""
    count = filter_count() if found["pymeshlab"] else None
    if count is None:
        line("mesh files", "without PyMeshLab, trimesh reads them")
    elif count < FILTERS:
        line("mesh files", f"PyMeshLab has {count} of {FILTERS} filters; what it lacks, as PLY, goes through trimesh")
    else:
        line("mesh files", f"PyMeshLab has all of its {count} filters")
    if count is None and found["trimesh"] is None:
        return ["there is no reader of mesh files: pip install pymeshlab trimesh"]
    return []


def _kernels() -> list[str]:
    """Compile and run a tiny kernel on each device -> problems."""
    start_warp()
    import warp as wp

    from oneform_warp.cli.trial import try_device

    problems = []
    for device in wp.get_devices():
        seconds, fault = try_device(device)
        line("device", f"{device.alias} ({device.name}): " + (fault or f"kernels compile and run, {seconds:.1f} s"))
        if fault and device == wp.get_device():
            problems.append(f"kernels do not run on {device.alias}, the device of choice: {fault}")
    line("kernel cache", str(wp.config.kernel_cache_dir))
    return problems
