"""``import filters`` and ``import datasets`` at the repository's root: the installed modules, never second copies."""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType

INSTALLED = {"filters": "mocap.filters", "datasets": "mocap.datasets"}
"""Folders at the repository's root, and the names under which they are installed."""


class SameModule(MetaPathFinder, Loader):
    """Finds ``filters.x`` as ``mocap.filters.x``: a class imported under both names is one class."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module of a name below one of the two folders; the path of the folder is not asked."""
        del path, target
        return spec_from_loader(fullname, self) if fullname.partition(".")[0] in INSTALLED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The installed module, imported under its own name."""
        folder, _, below = spec.name.partition(".")
        module = import_module(".".join(filter(None, (INSTALLED[folder], below))))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """It has run already; its own specification, which the import replaced, comes back."""
        spec = module.__spec__
        if spec is not None and isinstance(spec.loader, SameModule):
            module.__spec__ = spec.loader_state


def hand_over(folder: str) -> None:
    """Let a folder of the repository's root be the installed package, its submodules included.

    Args:
        folder: The name that was imported, ``filters`` or ``datasets``.
    """
    if not any(isinstance(finder, SameModule) for finder in sys.meta_path):
        sys.meta_path.insert(0, SameModule())
    sys.modules[folder] = import_module(INSTALLED[folder])
