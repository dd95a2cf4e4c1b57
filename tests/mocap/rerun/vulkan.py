"""Whether pictures can be drawn here."""

import os
from pathlib import Path

import pytest

_DRIVERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")


def need_vulkan() -> None:
    """Skip where nothing can be drawn; never in continuous integration, where it must be installed."""
    named = any(os.environ.get(name) for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"))
    linux = Path("/proc").exists()
    installed = any(list(Path(folder).glob("*.json")) for folder in _DRIVERS if Path(folder).is_dir())
    if linux and not named and not installed and not os.environ.get("CI"):
        pytest.skip("no Vulkan driver, so no pictures: apt-get install mesa-vulkan-drivers")
