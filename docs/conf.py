"""Sphinx settings of the site; ``docs/build.py`` copies the pages, adds what is made from code, and builds."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
WORK = HERE.parent / "work"
sys.path.insert(0, str(HERE / "tools"))

project, author = "eal-mocap", "the eal-mocap authors"
project_copyright = author
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "sphinx_design",
    "shell",
]
exclude_patterns = ["tools", "build.py", "scripts", "extra", "experiments", "**/README.txt", "**/GALLERY_HEADER.rst"]
myst_enable_extensions = ["deflist", "colon_fence"]
myst_heading_anchors = 3
nitpicky = False
run_in = str(WORK)
language = "en"
highlight_language = "text"

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_default_options = {"members": True}
napoleon_numpy_docstring = False
napoleon_use_ivar = True

sphinx_gallery_conf = {
    "examples_dirs": ["scripts/tutorials", "scripts/gallery"],
    "gallery_dirs": ["tutorials/executed", "gallery/executed"],
    "filename_pattern": r"\.py$",
    "abort_on_example_error": True,
    "show_signature": False,
    "ignore_repr_types": r"matplotlib",
    "show_memory": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "only_warn_on_example_error": False,
    "copyfile_regex": "",
}

html_extra_path = ["extra"]
html_theme = "pydata_sphinx_theme"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "article_header_start": ["breadcrumbs"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "navbar_end": ["theme-switcher"],
    "pygments_light_style": "tango",
}


def setup(app) -> None:
    """Called by Sphinx; |x| in a docstring is a size, and no substitution of reStructuredText."""

    def sizes(_app, _what, _name, _obj, _options, lines: list[str]) -> None:
        lines[:] = ["``".join(_bars(line.split("``"))) for line in lines]

    app.connect("autodoc-process-docstring", sizes)


def _bars(parts: list[str]) -> list[str]:
    return [part if k % 2 else part.replace("|", r"\|") for k, part in enumerate(parts)]
