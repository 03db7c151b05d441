"""Foreign file formats by name. Adding one = a file, a line in `FORMATS` and one in `SUMMARIES`."""

FORMATS: dict[str, str] = {}

SUMMARIES: dict[str, str] = {}
