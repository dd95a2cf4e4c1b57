"""Make the environment of the released tools: ``python -m benchmarks.gaps.peers.released.make_env``.

It lies in ``.venv-peers`` beside the project's own and is ignored by git. pose2sim is installed without its
dependencies (pose estimation, OpenSim, Qt), of which its filters import only those that ``requirements.txt`` names.
``--disk`` adds DISK and PyTorch (some 6 GB), for ``benchmarks.gaps.learning_curve``.
"""

import subprocess
import sys
import venv
from pathlib import Path

ENV = Path(__file__).resolve().parents[4] / ".venv-peers"
POSE2SIM = "pose2sim==0.10.49"
DISK = ("disk-impute==1.0.1.post79", "torch==2.6.0")


def interpreter() -> Path:
    """Python of the environment."""
    return ENV / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def main() -> None:
    """Create the environment and install what is pinned."""
    venv.create(ENV, with_pip=True)
    (ENV / ".gitignore").write_text("*\n")
    pip = [str(interpreter()), "-m", "pip", "install", "--quiet"]
    subprocess.run([*pip, "-r", str(Path(__file__).with_name("requirements.txt"))], check=True)
    subprocess.run([*pip, "--no-deps", POSE2SIM], check=True)
    if "--disk" in sys.argv[1:]:
        subprocess.run([*pip, *DISK], check=True)


if __name__ == "__main__":
    main()
