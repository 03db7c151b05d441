"""The border to the operating system: files read and written, streams, processes, text that leaves the program."""
