"""The report of a comparison: page, charts, tables and text."""
