"""The schema of the report, `camcal-report/1`: one definition that writes, reads, checks and documents it.

A section is a `Struct` here; each field has a type, its range and the text that docs/report.md shows
(`python -m camcal.report.schema.keys` renews the tables there). Keys are only ever added; a new key that is not
always written has the default `UNSET`. `structure` reads a document and names the path to a bad value.
"""

from camcal.report.schema.report import Report
from camcal.report.schema.structure import structure
from camcal.report.schema.version import NAME, SCHEMA, VERSION, check

__all__ = ["NAME", "SCHEMA", "VERSION", "Report", "check", "structure"]
