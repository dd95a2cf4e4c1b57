"""One class for each kind of trouble that a caller can act on; the message says what to do."""


class MocapError(Exception):
    """Any trouble with a recording that its user can mend."""


class FormatError(MocapError):
    """A file does not hold what its format promises."""


class CalibrationError(MocapError):
    """Cameras and pixels do not belong together, or cannot be told apart."""


class SkeletonError(MocapError):
    """A skeleton and the markers of a recording disagree."""


class OutputError(MocapError):
    """A result cannot be written there.

    Attributes:
        kept: What became of the earlier result.
    """

    def __init__(self, message: str, *, kept: str = "") -> None:
        """With what was kept, if anything is to be said of it."""
        super().__init__(message)
        self.kept = kept
