"""The error that every package derives its own from."""


class MocapError(Exception):
    """Any trouble with data that its user can mend.

    Attributes:
        page: The page of ``docs/`` that says more; None: the command line names that of the command.
        mends: Arguments by which it can be mended, where there is no doubt.
    """

    page: str | None = None
    mends: tuple[str, ...] = ()
