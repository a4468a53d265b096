"""What can go wrong, by name: errors for input that cannot be used, warnings for results to look at."""

__all__ = ["FileError", "InputError", "NotConverged", "OneFormWarning"]


class InputError(ValueError):
    """Input that cannot be used: what is wrong, where it is, and what to do about it."""

    def __init__(self, what: str, *, where: str = "", fix: str = "") -> None:
        self.what, self.where, self.fix = what, where, fix
        text = f"{where}: {what}" if where else what
        super().__init__(f"{text}; {fix}" if fix else text)


class FileError(InputError):
    """A file that cannot be read or written; `where` is its path."""


class OneFormWarning(UserWarning):
    """A result that can be used but should be looked at."""


class NotConverged(OneFormWarning):
    """The solver stopped before the residual was small enough; the positions are the best so far."""
