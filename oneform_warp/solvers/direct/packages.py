"""Packages that one solver needs and the others do not."""

from __future__ import annotations

from importlib.util import find_spec

from oneform_warp.errors import InputError

__all__ = ["require"]


def require(solver: str, packages: tuple[str, ...], extra: str) -> None:
    """InputError that names the extra to install, unless all packages are there; imports none of them."""
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        raise InputError(
            f"{solver} needs {' and '.join(missing)}, not installed here",
            where="solver",
            fix=f"run: pip install 'oneform-warp[{extra}]'",
        )
