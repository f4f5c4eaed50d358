"""Named errors. Each says what was refused, where it stands, and what would do."""

from __future__ import annotations


class CgiWaveError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(CgiWaveError):
    """An input was refused.

    Parameters are kept as attributes so that a caller can act on them.

    file : name of the file (or ``"command line"``), field : dotted name of the field inside it,
    value : what stood there, remedy : what would do.
    """

    def __init__(self, file: str, field: str, value: object, problem: str, remedy: str) -> None:
        self.file, self.field, self.value = file, field, value
        self.problem, self.remedy = problem, remedy
        super().__init__(f"{file}: {field} = {value!r}: {problem}; {remedy}")

    def __reduce__(self) -> tuple[object, ...]:
        """An error crosses from one process to another by the arguments that it was made of."""
        return type(self), (self.file, self.field, self.value, self.problem, self.remedy)


class MethodLimitError(CgiWaveError):
    """A numerical method was asked for something outside its range.

    method : its name, limit : the limit in words and numbers, factor : by how much it is exceeded (1 = at the limit).
    """

    def __init__(self, method: str, limit: str, factor: float, remedy: str) -> None:
        self.method, self.limit, self.factor, self.remedy = method, limit, factor, remedy
        super().__init__(f"{method}: {limit}, exceeded {factor:.3g} times; {remedy}")

    def __reduce__(self) -> tuple[object, ...]:
        """See ``InputError``."""
        return type(self), (self.method, self.limit, self.factor, self.remedy)


class EmptyBeamError(CgiWaveError):
    """No ray of a path reached the place where it was needed."""


class FoldedFieldError(CgiWaveError):
    """The map from pupil to direction cosines folds or collapses: the direction-space field does not exist."""


class MissingPackageError(CgiWaveError):
    """A method needs a package that is not installed: its name, and the extra that brings it."""

    def __init__(self, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f"{package} is not installed; install the extra: pip install 'cgi-wave[{extra}]'")

    def __reduce__(self) -> tuple[object, ...]:
        """See ``InputError``."""
        return type(self), (self.package, self.extra)
