"""The name of the report's schema; the schema itself is `camcal.schema`."""

from camcal.schema import NAME, SCHEMA, VERSION, check

__all__ = ["NAME", "SCHEMA", "VERSION", "check"]
