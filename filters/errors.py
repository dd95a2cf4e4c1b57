"""What goes wrong in learning and tracking."""

from eal.errors import MocapError


class FilterError(MocapError):
    """Trials, markers or a model do not fit each other; the message says what to do."""
