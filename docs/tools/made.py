"""Pages of the reference that are made from the program's own code."""

from docs.tools import columns, commands, formats, house, licences, record

PAGES = {
    "reference/commands.md": commands.page,
    "reference/formats.md": formats.page,
    "reference/record.md": record.page,
    "reference/files.md": columns.page,
    "reference/house.md": house.page,
    "reference/licences.md": licences.page,
}
"""Where each lies in the site, and what makes it."""
