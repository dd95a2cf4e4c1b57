"""Learn a model from several recordings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from mocap.errors import MocapError
from mocap.filters.hidden_gaps import MODELS, WITH_JOINTS
from mocap.filters.model import LearnedModel
from mocap.io.output import result_file
from mocap.pipeline.arrays import as_recording
from mocap.pipeline.learning import learn_from, readable_scores
from mocap.pipeline.model_file import load_model as read_model_file
from mocap.pipeline.model_file import save_model
from mocap.pipeline.recording import Recording


@dataclass(frozen=True, eq=False)
class Model:
    """How one kind of animal moves, learned from recordings of it.

    Attributes:
        learned: The recordings and what was chosen on them.
    """

    learned: LearnedModel

    @property
    def scores(self) -> dict[str, dict[str, list[float]]]:
        """Of each motion model, by length of gap: ``rmse_mm``, ``coverage95``, ``z`` in gaps hidden while learning."""
        return self.learned.scores

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write it to an ``.npz`` file.

        Args:
            path: The file.
            overwrite: Whether a model that was written there before may be replaced.

        Raises:
            OutputError: it cannot be written there, or a file that is not ours is in its place.
        """
        with result_file(Path(path), replace=overwrite) as file:
            self.write(file)

    def write(self, file: Path) -> None:
        """Write the file of ``save``, as ``mocap.io.output.result_file`` gives it."""
        save_model(self.learned, file)

    def __repr__(self) -> str:
        """One line."""
        trials = ", ".join(trial.name for trial in self.learned.trials)
        return f"<Model of {len(self.learned.names)} markers, learned from {trials}>"

    @property
    def report_text(self) -> str:
        """What was learned and how well it fills gaps, as markdown."""
        return readable_scores(self.learned)

    @property
    def scores_text(self) -> str:
        """How well it fills gaps, as markdown: the first part of ``report_text``."""
        return self.report_text.partition("\nDistances that")[0]

    def _repr_markdown_(self) -> str:
        return self.report_text


def learn(
    recordings: Sequence[Recording],
    *,
    joints: bool = False,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _line: None,
) -> Model:
    """Learn a motion model of one kind of animal from several recordings, to track others with.

    Args:
        recordings: As ``mocap.read`` gives them, of one frame rate; markers of the same name are the same.
        joints: Whether joint angles of rigid segments are a model as well, mixed with that of the pose: nearer on
            animals with rigid bones and of other sizes, tracking takes 1.5 to 2.3 times as long. The skeleton states
            the bones.
        seed: Which samples are hidden to choose and to calibrate.
        progress: Called with a line for each recording, and for each in which hidden gaps are filled.

    Raises:
        MocapError: they cannot be learned from together; or joints are wanted, and the skeleton states none.
    """
    if isinstance(recordings, str | PathLike | Recording):
        raise MocapError(f"mocap.learn takes a list of recordings, not {type(recordings).__name__}: mocap.learn([...])")
    models = WITH_JOINTS if joints else MODELS
    recordings = [as_recording(recording, "learn") for recording in recordings]
    return Model(learn_from(recordings, seed=seed, models=models, tell=progress))


def load_model(path: str | PathLike[str]) -> Model:
    """A model that ``mocap learn`` or ``Model.save`` wrote.

    Raises:
        FormatError: the file is none, or damaged, or of another version.
    """
    return Model(read_model_file(Path(path)))
