"""`python -m oneform_warp.cli` is `oneform-warp`."""

from oneform_warp.cli.commands import main

main(prog_name="oneform-warp")
