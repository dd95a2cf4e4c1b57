"""The shell: command line, rerun views, tables and reports."""
