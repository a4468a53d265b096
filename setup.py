"""The list of packages, which `pyproject.toml` cannot say: what is found, and the filters without their link.

The link oneform_warp/filters is lost in a source distribution and in checkouts without symbolic links.
"""

from setuptools import find_packages, setup

found = find_packages(include=["oneform_warp", "oneform_warp.*"])
linked = [f"oneform_warp.filters.{name}" for name in find_packages("filters")]
setup(packages=sorted({*found, "oneform_warp.filters", *linked}))
