"""One class for each kind of trouble that a caller can act on; the message says what to do."""

from eal.errors import MocapError

__all__ = ["CalibrationError", "FormatError", "MocapError", "OutputError", "SkeletonError"]


class FormatError(MocapError):
    """A file does not hold what its format promises."""

    page = "howto/your_files.md"


class CalibrationError(MocapError):
    """Cameras and pixels do not belong together, or cannot be told apart."""

    page = "howto/calibration.md"


class SkeletonError(MocapError):
    """A skeleton and the markers of a recording disagree."""

    page = "howto/skeleton.md"


class OutputError(MocapError):
    """A result cannot be written there.

    Attributes:
        kept: What became of the earlier result.
    """

    page = "reference/files.md"

    def __init__(self, message: str, *, kept: str = "") -> None:
        """With what was kept, if anything is to be said of it."""
        super().__init__(message)
        self.kept = kept
