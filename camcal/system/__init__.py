"""The interface to the operating system: files read and written, streams, processes, text output."""
