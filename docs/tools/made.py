"""Pages of the reference that are made from the program's own code."""

from docs.tools import columns, commands, formats

PAGES = {
    "reference/commands.md": commands.page,
    "reference/formats.md": formats.page,
    "reference/files.md": columns.page,
}
"""Where each lies in the site, and what makes it."""
