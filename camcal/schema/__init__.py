"""The schema of the report, `camcal-report/1`: one definition that writes, reads, checks and documents it.

A section is a `Struct` here; each field has a type, its range and the text that docs/report.md shows
(`python -m camcal.schema.keys docs/report.md` renews the tables there). Keys are only ever added; a new key that is
not always written has the default `UNSET`. `structure` reads a document and names the path to a bad value;
`unknown_key` finds a key that no document may be written with.
"""

from camcal.schema.camera import Camera
from camcal.schema.report import Report
from camcal.schema.structure import structure, unknown_key
from camcal.schema.version import NAME, SCHEMA, VERSION, check

__all__ = ["NAME", "SCHEMA", "VERSION", "Camera", "Report", "check", "structure", "unknown_key"]
