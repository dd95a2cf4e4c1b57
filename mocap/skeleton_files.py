"""Files that a skeleton is read from: its own (TOML), and models of other programs."""

from pathlib import Path

from mocap.errors import FormatError, SkeletonError
from mocap.skeleton import Skeleton, skeleton_from_toml, skeleton_text


def read_skeleton(path: Path) -> Skeleton:
    """Read a skeleton, or a model as one (``.osim``, ``.bioMod``, ``.urdf``, MJCF's ``.xml``; ``model_skeleton``).

    Raises:
        SkeletonError: the file cannot be read as that.
        MissingPackageError: a library that reads the model is not installed.
    """
    return read_model(path)[0] if is_model(path) else skeleton_from_toml(path)


def is_model(path: Path) -> bool:
    """Whether a file is a model of another program, by the end of its name."""
    return path.suffix.lower() in (".osim", ".biomod", ".urdf", ".xml", ".mjcf")


def read_model(path: Path) -> tuple[Skeleton, str]:
    """A model as a skeleton, and as a skeleton file that says what was not taken.

    Raises:
        SkeletonError: the file cannot be read as that.
        MissingPackageError: a library that reads the model is not installed.
    """
    from mocap.skeleton_models import model_skeleton  # which loads scipy.spatial

    try:
        parts, comments = model_skeleton(path)
        skeleton = Skeleton(**parts)
    except (OSError, FormatError) as error:
        raise SkeletonError(str(error)) from None
    except SkeletonError as error:
        raise SkeletonError(f"{path}: {error}") from None
    return skeleton, skeleton_text(skeleton, comments=comments)
