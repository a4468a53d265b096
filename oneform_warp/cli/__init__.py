"""The command line: oneform-warp deform, batch, recipe, info, doctor and demo.

Modules that a command imports at its top load fast; what needs NumPy, Warp or MeshLab is imported when it runs.
"""

from oneform_warp.cli.commands import main

__all__ = ["main"]
